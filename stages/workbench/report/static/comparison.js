// The figures of a comparison, in the page's colours; the library is 5 MB, so the page is shown first.
"use strict";

(() => {
  const CONFIG = { displayModeBar: false, responsive: true };
  const data = JSON.parse(document.getElementById("data").textContent);

  function look(layout) {
    const axis = { gridcolor: b23d.theme.color("--line"), zerolinecolor: b23d.theme.color("--line"), linecolor: b23d.theme.color("--line") };
    return {
      ...layout, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: b23d.theme.color("--text"), family: "inherit", size: 12 },
      xaxis: { ...layout.xaxis, ...axis }, yaxis: { ...layout.yaxis, ...axis },
      hoverlabel: { ...layout.hoverlabel, bgcolor: b23d.theme.color("--card"), font: { color: b23d.theme.color("--text") } },
    };
  }

  function draw() {
    const script = document.createElement("script"), text = document.getElementById("plotly");
    script.textContent = text.textContent;
    document.head.append(script);
    text.remove();
    for (const [key, figure] of Object.entries(data.figures)) {
      const place = document.getElementById(`figure-${key}`);
      Plotly.newPlot(place, figure.data, look(figure.layout), CONFIG);
      b23d.theme.onChange(() => Plotly.relayout(place, look(figure.layout)));
    }
  }

  document.getElementById("theme").addEventListener("click", b23d.theme.toggle);
  if (Object.keys(data.figures).length) requestAnimationFrame(() => setTimeout(draw, 20));
})();
