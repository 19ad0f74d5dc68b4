// The table of shapes: sorted by any column, filtered, and drawn as far as it is scrolled.
"use strict";

(() => {
  const CHUNK = 80;
  const state = { key: "name", descending: false, shown: [], drawn: 0 };
  const figure = (digits) => (value) => (value == null ? "" : value.toFixed(digits).replace(/^(-?)0\./, "$1."));
  const percent = (value) => (value == null ? "" : value === 0 ? "0 %" : `${(100 * value).toFixed(1)} %`);
  const whole = (value) => (value == null ? "" : String(Math.round(10 * value) / 10));
  const CELLS = {   // by the word for how a column is shown, of results/columns.py
    name: nameCell, draws: drawsCell,
    figure2: (row, column) => numberCell(row, column, figure(2)), figure3: (row, column) => numberCell(row, column, figure(3)),
    percent: (row, column) => numberCell(row, column, percent), whole: (row, column) => numberCell(row, column, whole),
  };
  let body, counter, rows, filters;

  b23d.startTable = (open) => {
    body = document.querySelector("#shape-table tbody");
    counter = document.getElementById("shape-count");
    rows = b23d.data.rows;
    filters = Object.fromEntries(["text", "class", "state", "most"].map((name) => [name, document.getElementById(`filter-${name}`)]));
    document.querySelectorAll("#shape-table th button").forEach((button) => button.addEventListener("click", () => sort(button.dataset.key)));
    Object.values(filters).forEach((input) => input.addEventListener("input", refresh));
    body.addEventListener("click", (event) => choose(event, open));
    body.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(event, open); });
    new IntersectionObserver((seen) => seen.some((entry) => entry.isIntersecting) && draw(), { rootMargin: "600px" }).observe(document.getElementById("more"));
    refresh();
  };

  b23d.shownRows = () => state.shown;

  function choose(event, open) {
    const line = event.target.closest("tr");
    if (line) open(rows[Number(line.dataset.place)].name);
  }

  function sort(key) {
    state.descending = state.key === key ? !state.descending : key !== "name";
    state.key = key;
    refresh();
  }

  function value(row) {
    const found = row[state.key];
    return Array.isArray(found) ? found.length : found;
  }

  function refresh() {
    const text = filters.text.value.trim().toLowerCase(), most = Number(filters.most.value);
    document.getElementById("most-value").textContent = most < 1 ? `≤ ${most.toFixed(2)}` : "any";
    state.shown = rows.filter((row) => (!text || `${row.name} ${row.errors.join(" ")}`.toLowerCase().includes(text))
      && (!filters.class.value || row.category === filters.class.value)
      && (!filters.state.value || (filters.state.value === "shot" ? row.shot.length > 0 : row.state === filters.state.value))
      && (most >= 1 || (row.auc != null && row.auc <= most)));
    state.shown.sort((a, b) => compare(value(a), value(b)) || compare(a.name, b.name));
    document.querySelectorAll("#shape-table th").forEach((cell) => {
      const key = cell.querySelector("button")?.dataset.key;
      cell.setAttribute("aria-sort", key !== state.key ? "none" : state.descending ? "descending" : "ascending");
    });
    counter.textContent = state.shown.length === rows.length ? many(rows.length) : `${state.shown.length} of ${many(rows.length)}`;
    body.replaceChildren();
    state.drawn = 0;
    draw();
  }

  function many(count) {
    return count === 1 ? "1 shape" : `${count} shapes`;
  }

  function many(count) {
    return count === 1 ? "1 shape" : `${count} shapes`;
  }

  function compare(a, b) {   // what is missing stays last, whichever way
    if (a == null || b == null) return (a == null) - (b == null);
    const order = typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b;
    return state.descending ? -order : order;
  }

  function draw() {
    const next = state.shown.slice(state.drawn, state.drawn + CHUNK);
    body.append(...next.map(line));
    state.drawn += next.length;
  }

  function line(row) {
    const element = document.createElement("tr");
    element.dataset.place = row.place;
    element.tabIndex = 0;
    element.className = row.state;
    element.append(...b23d.data.columns.map((column) => CELLS[column.shown](row, column)));
    return element;
  }

  function numberCell(row, { key, bar }, format) {
    const cell = document.createElement("td");
    cell.className = "number";
    cell.textContent = format(row[key]);
    if (bar && row[key] != null) {
      cell.classList.add("bar");
      cell.style.setProperty("--share", `${100 * row[key]}%`);
    }
    return cell;
  }

  function nameCell(row) {
    const cell = document.createElement("td"), box = document.createElement("div"), words = document.createElement("div");
    box.className = "named";
    const image = document.createElement(row.thumb ? "img" : "span");
    image.className = "thumb";
    if (row.thumb) Object.assign(image, { src: row.thumb, alt: "", loading: "lazy", width: 56, height: 56 });
    const id = document.createElement("b"), below = document.createElement("small");
    id.textContent = row.id;
    id.title = row.id;
    below.textContent = row.category + (row.kind ? ` · ${row.kind}` : "");
    words.append(id, below);
    box.append(image, words);
    if (row.errors.length) box.append(badge("failed", row.errors.join("\n")));
    else if (row.state === "waiting") box.append(badge("waiting", "not run yet"));
    else if (row.state === "unpredicted") box.append(badge("unpredicted", row.lack));
    cell.append(box);
    return cell;
  }

  function drawsCell(row) {
    const cell = document.createElement("td");
    if (row.shot.length) cell.append(badge(`shot in ${row.shot.join(", ")}`, "one of the shots of these draws"));
    const draws = document.createElement("span");
    draws.textContent = row.draws.join(", ");
    cell.append(" ", draws);
    return cell;
  }

  function badge(text, title) {
    const element = document.createElement("span");
    element.className = `badge ${text.split(" ")[0]}`;
    element.textContent = text;
    element.title = title;
    return element;
  }
})();
