// Start the page: what it shows lies in it as JSON.
"use strict";

(() => {
  b23d.data = JSON.parse(document.getElementById("data").textContent);
  b23d.data.rows.forEach((row, place) => { row.place = place; });
  document.getElementById("theme").addEventListener("click", b23d.theme.toggle);
  const open = b23d.startViewer();
  b23d.startTable(open);
  document.querySelectorAll("[data-open]").forEach((element) => element.addEventListener("click", () => open(element.dataset.open)));
  const named = () => { try { return decodeURIComponent(location.hash.slice(1)); } catch { return ""; } };
  const follow = () => { if (b23d.data.rows.some((row) => row.name === named())) open(named()); };
  window.addEventListener("hashchange", follow);
  follow();
  b23d.plotly().then(b23d.startCurves);
})();
