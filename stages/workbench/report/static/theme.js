// Light or dark: the system's choice until the reader chooses. Figures follow.
"use strict";
window.b23d = window.b23d || {};

(() => {
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  try { chosen = localStorage.getItem("b23d-theme"); } catch { /* pages from a disk may have no storage */ }
  const listeners = [];

  const isDark = () => (chosen ? chosen === "dark" : system.matches);
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function apply() {
    document.documentElement.dataset.theme = isDark() ? "dark" : "light";
    listeners.forEach((listener) => listener());
  }

  function toggle() {
    chosen = isDark() ? "light" : "dark";
    try { localStorage.setItem("b23d-theme", chosen); } catch { /* as above */ }
    apply();
  }

  system.addEventListener("change", apply);
  b23d.theme = { color, toggle, onChange: (listener) => listeners.push(listener) };
  apply();
})();
