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
    b23d.theme.onChange(async () => { for (const scene of scenes) await scene.theme(); paint(); });
    return open;
  };

  function rowOf(name) { return b23d.data.rows.find((row) => row.name === name); }

  async function open(name) {
    const row = rowOf(name), mine = ++ticket;
    if (!row) return;
    Object.assign(state, { shapes: [null, null], reference: null });
    if (!dialog.open) dialog.showModal();
    dialog.focus();
    history.replaceState(null, "", `#${encodeURIComponent(name)}`);
    part("title").textContent = row.id;
    part("subtitle").textContent = b23d.panel.subtitle(row);
    part("errors").textContent = row.errors.join("\n");
    part("side-1").hidden = true;
    part("name-0").textContent = "";
    scenes[1].close();
    b23d.panel.fillOthers(row);
    const [shape] = await Promise.all([read(row, mine), b23d.plotly()]);
    if (mine !== ticket) return;
    part("controls").hidden = !shape;
    if (!shape) { scenes[0].close(); return; }
    state.shapes[0] = shape;
    state.draw = b23d.panel.fillDraws(shape, state.draw);
    for (const input of dialog.querySelectorAll("[name=mode]")) input.disabled = !NEEDS[input.value](shape);
    if (!NEEDS[state.mode](shape)) state.mode = "plain";
    dialog.querySelector(`[name=mode][value=${state.mode}]`).checked = true;
    dialog.querySelectorAll("[data-for=surface]").forEach((element) => { element.hidden = !shape.surface; });
    await scenes[0].show(shape);
    if (mine === ticket) await paint();
  }

  async function read(row, mine) {
    const none = row.points ? "no 3D view of this shape in this report; make one with more: b23d report RUN --details N" : "not run yet";
    message(row.details ? "loading …" : row.errors.length ? "" : none);
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
      part("name-0").textContent = "";
      state.shapes[1] = null;
      if (state.reference?.side === 1) state.reference = null;
      await refit();
      return paint();
    }
    const shape = await read(row, mine);
    if (mine !== ticket || !shape || part("other").value !== name) return undefined;
    state.shapes[1] = shape;
    if (state.reference?.side === 1) state.reference = null;
    part("name-0").textContent = state.shapes[0].name.split("/").pop();
    part("name-1").textContent = row.id;
    await refit();
    return paint();
  }

  // Panels have changed their width: both take the same first view again.
  async function refit() {
    const far = (camera) => Math.hypot(...Object.values(camera.eye));
    const views = scenes.filter((scene, side) => state.shapes[side]).map((scene, side) => scene.fitted(state.shapes[side]));
    const camera = views.reduce((a, b) => (far(b) > far(a) ? b : a));
    for (const [side, shape] of state.shapes.entries()) {
      if (!shape) continue;
      await scenes[side].show(shape, camera);
      await Plotly.Plots.resize(part(`scene-${side}`));
    }
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
    const hint = HINTS[state.mode] && !state.reference ? HINTS[state.mode] : "";
    b23d.panel.legend(painted[state.reference?.side ?? 0]?.field ?? painted[0].field, hint);
    b23d.panel.keypoints(first, attemptOf(first));
    part("dialog").dataset.painted = "";
    for (const [side, item] of painted.entries()) {
      if (item && scenes[side].shape) await scenes[side].paint(item.field, attemptOf(state.shapes[side]), state.options, item.marked);
    }
    part("dialog").dataset.painted = `${state.mode} ${state.reference ? `${state.reference.side}:${state.reference.point}` : ""}`.trim();
  }

  const attemptOf = (shape) => shape.attempts.find((attempt) => attempt.draw === state.draw) || null;
  const message = (text) => { part("message").textContent = text; };

  function step(by) {
    const shown = b23d.shownRows(), at = shown.findIndex((row) => row.name === decodeURIComponent(location.hash.slice(1)));
    const next = shown[at + by];
    if (next) open(next.name);
  }
})();
