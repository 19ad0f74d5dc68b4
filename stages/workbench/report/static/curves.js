// Score curves: the figure that stages/workbench/pictures/figures.py made, in the page's colours.
"use strict";

(() => {
  const CONFIG = { displayModeBar: false, responsive: true };

  function look() {
    const axis = { gridcolor: b23d.theme.color("--line"), zerolinecolor: b23d.theme.color("--line"), linecolor: b23d.theme.color("--line") };
    return {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: b23d.theme.color("--text"), family: "inherit", size: 12 },
      xaxis: axis, yaxis: axis, hoverlabel: { bgcolor: b23d.theme.color("--card"), font: { color: b23d.theme.color("--text") } },
    };
  }

  const merge = (layout, extra) => ({ ...layout, ...extra, xaxis: { ...layout.xaxis, ...extra.xaxis }, yaxis: { ...layout.yaxis, ...extra.yaxis } });

  b23d.startCurves = () => {
    const place = document.getElementById("curves"), figure = b23d.data.curves;
    if (!place || !figure) return;
    Plotly.newPlot(place, figure.data, merge(figure.layout, look()), CONFIG);
    b23d.theme.onChange(() => Plotly.relayout(place, merge(figure.layout, look())));
  };
})();
