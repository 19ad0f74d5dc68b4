// The figures of a comparison or an analysis, in the page's colours: each is drawn in the element `figure-<key>`.
"use strict";

(() => {
  const CONFIG = { displayModeBar: false, responsive: true };
  const { figures } = JSON.parse(document.getElementById("data").textContent);

  function look(layout) {
    const { color } = b23d.theme, axis = { gridcolor: color("--line"), zerolinecolor: color("--line"), linecolor: color("--line") };
    const axes = Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key));
    return {
      ...layout, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { ...layout.font, color: color("--text"), family: "inherit" },
      ...Object.fromEntries(axes.map((key) => [key, { ...layout[key], ...axis }])),
      hoverlabel: { ...layout.hoverlabel, bgcolor: color("--card"), font: { color: color("--text") } },
    };
  }

  function draw() {
    for (const [key, figure] of Object.entries(figures)) {
      const place = document.getElementById(`figure-${key}`);
      Plotly.newPlot(place, figure.data, look(figure.layout), CONFIG);
      b23d.theme.onChange(() => Plotly.relayout(place, look(figure.layout)));
    }
  }

  document.getElementById("theme").addEventListener("click", b23d.theme.toggle);
  if (Object.keys(figures).length) b23d.plotly().then(draw);
})();
