// Start the page: what it shows lies in it as JSON.
"use strict";

(() => {
  b23d.data = JSON.parse(document.getElementById("data").textContent);
  b23d.data.rows.forEach((row, place) => { row.place = place; });
  // The library is 5 MB: the page is shown first, figures come right after.
  let started = null;
  b23d.plotly = () => {
    started ||= shown().then(() => {
      const script = document.createElement("script"), text = document.getElementById("plotly");
      script.textContent = text.textContent;
      document.head.append(script);
      text.remove();
    });
    return started;
  };
  // Resolves when the browser has painted; a page in the background does not paint, and does not wait for ever.
  const shown = () => new Promise((resolve) => {
    requestAnimationFrame(() => setTimeout(resolve, 20));
    setTimeout(resolve, 1500);
  });
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
