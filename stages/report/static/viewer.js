// The 3D view of one shape, or of two of a class side by side: modes, draws, keypoints.
"use strict";

(() => {
  const HINTS = {
    geodesic: "Click a point: distances along the surface from there.",
    similarity: "Click a point: how alike the features of all others are, here and on the other shape.",
  };
  const NEEDS = { plain: () => true, pca: (s) => s.colors, views: (s) => s.counts, geodesic: (s) => s.distances, similarity: (s) => s.features };
  const state = { shapes: [null, null], mode: "pca", draw: null, reference: null, options: {} };
  let dialog, scenes, ticket = 0;
  const part = (name) => document.getElementById(`viewer-${name}`);

  b23d.startViewer = () => {
    dialog = part("dialog");
    scenes = [0, 1].map((side) => new b23d.Scene(part(`scene-${side}`), (point) => pick(side, point), (camera) => scenes[1 - side].follow(camera)));
    dialog.querySelectorAll("[name=mode]").forEach((input) => input.addEventListener("change", () => { state.mode = input.value; paint(); }));
    dialog.querySelectorAll("[data-option]").forEach((input) => {
      state.options[input.dataset.option] = input.checked;
      input.addEventListener("change", () => { state.options[input.dataset.option] = input.checked; paint(); });
    });
    part("draw").addEventListener("change", () => { state.draw = Number(part("draw").value); paint(); });
    part("other").addEventListener("change", () => compare(part("other").value));
    part("close").addEventListener("click", () => dialog.close());
    part("previous").addEventListener("click", () => step(-1));
    part("next").addEventListener("click", () => step(1));
    dialog.addEventListener("close", () => { ticket++; scenes.forEach((scene) => scene.close()); history.replaceState(null, "", location.pathname + location.search); });
    dialog.addEventListener("keydown", (event) => {
      if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
      if (event.key === "ArrowLeft") step(-1);
      if (event.key === "ArrowRight") step(1);
    });
    b23d.theme.onChange(() => scenes.forEach((scene) => scene.theme()));
    return open;
  };

  function rowOf(name) { return b23d.data.rows.find((row) => row.name === name); }

  async function open(name) {
    const row = rowOf(name), mine = ++ticket;
    if (!row) return;
    Object.assign(state, { shapes: [null, null], reference: null });
    if (!dialog.open) dialog.showModal();
    history.replaceState(null, "", `#${encodeURIComponent(name)}`);
    part("title").textContent = row.id;
    part("subtitle").textContent = subtitle(row);
    part("errors").textContent = row.errors.join("\n");
    part("side-1").hidden = true;
    scenes[1].close();
    fillOthers(row);
    const shape = await read(row, mine);
    if (mine !== ticket) return;
    part("controls").hidden = !shape;
    if (!shape) { scenes[0].close(); return; }
    state.shapes[0] = shape;
    fillDraws(shape);
    for (const input of dialog.querySelectorAll("[name=mode]")) input.disabled = !NEEDS[input.value](shape);
    if (!NEEDS[state.mode](shape)) state.mode = "plain";
    dialog.querySelector(`[name=mode][value=${state.mode}]`).checked = true;
    dialog.querySelectorAll("[data-for=surface]").forEach((element) => { element.hidden = !shape.surface; });
    await scenes[0].show(shape);
    if (mine === ticket) await paint();
  }

  async function read(row, mine) {
    message(row.details ? "loading …" : row.errors.length ? "" : "no 3D view of this shape in this report; make one with more: b23d report RUN --details N");
    if (!row.details) return null;
    try {
      const shape = await b23d.load(row.details);
      if (mine === ticket) message("");
      return shape;
    } catch (error) {
      if (mine === ticket) message(error.message);
      return null;
    }
  }

  async function compare(name) {
    const mine = ticket, row = rowOf(name);
    part("side-1").hidden = !row;
    if (!row) {
      scenes[1].close();
      state.shapes[1] = null;
      if (state.reference?.side === 1) state.reference = null;
      window.dispatchEvent(new Event("resize"));
      return paint();
    }
    const shape = await read(row, mine);
    if (mine !== ticket || !shape || part("other").value !== name) return undefined;
    state.shapes[1] = shape;
    if (state.reference?.side === 1) state.reference = null;
    part("name-1").textContent = row.id;
    scenes[1].camera = scenes[0].camera;
    await scenes[1].show(shape);
    window.dispatchEvent(new Event("resize"));
    return paint();
  }

  function pick(side, point) {
    state.reference = { side, point };
    if (!HINTS[state.mode]) {
      state.mode = state.shapes[side].features ? "similarity" : "geodesic";
      if (!NEEDS[state.mode](state.shapes[side])) return;
      dialog.querySelector(`[name=mode][value=${state.mode}]`).checked = true;
    }
    paint();
  }

  // The field of each shown shape and the points to ring: what was clicked, and on the other shape what is most like it.
  function fieldsNow() {
    const { mode, reference, shapes } = state, { plain, pca, views, geodesic, similarity, vectorOf, best } = b23d.fields;
    if (!HINTS[mode]) {
      const make = { plain, pca, views }[mode];
      return shapes.map((shape) => shape && { field: make(shape) || plain(shape), marked: [] });
    }
    if (!reference) return shapes.map((shape) => shape && { field: plain(shape), marked: [] });
    const vector = vectorOf(shapes[reference.side], reference.point);
    return shapes.map((shape, side) => {
      if (!shape) return null;
      const alike = vector && similarity(shape, vector);
      const at = side === reference.side ? reference.point : alike ? best(alike.values) : null;
      const field = mode === "similarity" ? alike : at === null ? null : geodesic(shape, at);
      return { field: field || plain(shape), marked: at === null ? [] : [at] };
    });
  }

  async function paint() {
    const [first] = state.shapes;
    if (!first) return;
    const painted = fieldsNow();
    legend(painted[state.reference?.side ?? 0]?.field ?? painted[0].field);
    keypointTable(first, attemptOf(first));
    part("dialog").dataset.painted = "";
    for (const [side, item] of painted.entries()) {
      if (item && scenes[side].shape) await scenes[side].paint(item.field, attemptOf(state.shapes[side]), state.options, item.marked);
    }
    part("dialog").dataset.painted = `${state.mode} ${state.reference ? `${state.reference.side}:${state.reference.point}` : ""}`.trim();
  }

  const attemptOf = (shape) => shape.attempts.find((attempt) => attempt.draw === state.draw) || null;
  const message = (text) => { part("message").textContent = text; };

  function subtitle(row) {
    const facts = [row.category];
    if (row.points) facts.push(`${row.kind}, ${row.points} candidates`);
    if (row.auc != null) facts.push(`AUC ${row.auc.toFixed(3)}`, `IoU .10 ${row.iou10.toFixed(2)}`);
    if (row.shot.length) facts.push(`shot in draw ${row.shot.join(", ")}`);
    return facts.join(" · ");
  }

  function fillDraws(shape) {
    const options = shape.attempts.map((attempt) => {
      const auc = attempt.score && attempt.score.iou.reduce((a, b) => a + b, 0) / attempt.score.iou.length;
      return new Option(`draw ${attempt.draw}${auc == null ? "" : `: AUC ${auc.toFixed(3)}`}`, attempt.draw);
    });
    part("draw").replaceChildren(...(options.length ? options : [new Option("no prediction", "")]));
    part("draw").disabled = options.length < 2;
    const draws = shape.attempts.map((attempt) => attempt.draw), wanted = state.draw ?? b23d.data.draw;
    state.draw = draws.includes(wanted) ? wanted : (draws[0] ?? null);
    if (state.draw !== null) part("draw").value = state.draw;
  }

  function fillOthers(row) {
    const others = b23d.data.rows.filter((other) => other.category === row.category && other.name !== row.name && other.details);
    part("other").replaceChildren(new Option("nothing", ""), ...others.map((other) => new Option(other.id, other.name)));
    part("other").disabled = !others.length;
  }

  function step(by) {
    const shown = b23d.shownRows(), at = shown.findIndex((row) => row.name === decodeURIComponent(location.hash.slice(1)));
    const next = shown[at + by];
    if (next) open(next.name);
  }

  function legend(field) {
    const scalar = field.values !== null;
    part("bar").hidden = !scalar;
    if (scalar) {
      part("gradient").style.background = b23d.fields.gradient(field.map);
      part("low").textContent = Number(field.low.toFixed(2));
      part("high").textContent = Number(field.high.toFixed(2));
    }
    const hint = HINTS[state.mode] && !state.reference ? HINTS[state.mode] : "";
    part("legend").textContent = hint || [field.label, field.note].filter(Boolean).join(". ");
  }

  function keypointTable(shape, attempt) {
    const truth = new Set(shape.truth.map((k) => k.id)), found = new Set(attempt ? attempt.keypoints.map((k) => k.id) : []);
    const lines = attempt ? attempt.keypoints.map((k) => [k.id, k.present ? (truth.has(k.id) ? "" : "not annotated") : "judged absent", k.error, k.cost]) : [];
    for (const k of shape.truth) if (!found.has(k.id)) lines.push([k.id, attempt ? "not predicted" : "annotated", null, null]);
    part("keypoints").replaceChildren(...lines.map(([id, note, error, cost]) => {
      const line = document.createElement("tr");
      const color = id < 0 ? "#808080" : b23d.data.idColors[id % b23d.data.idColors.length];
      line.append(...[id < 0 ? "–" : id, error == null ? note : `${error.toFixed(3)}${note ? ` ${note}` : ""}`, cost == null ? "" : cost.toFixed(2)].map((text) => {
        const cell = document.createElement("td");
        cell.textContent = text;
        return cell;
      }));
      line.firstChild.style.setProperty("--dot", color);
      return line;
    }));
  }
})();
