// One 3D panel: a shape's points and surface, its keypoints, and what was clicked. Wraps a plotly figure.
"use strict";

(() => {
  const AZIMUTH = 0.65, ELEVATION = 0.38;   // of the first view, radians from the front: from the right, a little from above
  const SLOPE = Math.tan(Math.PI / 8), MARGIN = 1.12;   // of plotly's field of view; room around the shape
  const REACH = 0.58;   // half of the cube that is shown: shapes are centred, their longest side is 1
  const AXIS = { visible: false, showspikes: false, range: [-REACH, REACH] };
  const TRACES = ["surface", "points", "lines", "truth", "predicted", "reference", "labels"];   // their order is their index
  const STILL = 4;   // pixels a pointer may move between down and up and still click
  const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: true };
  const BALL = 0.017, PICKED = 0.02, LIFT = 0.045;   // lengths in the unit frame

  b23d.Scene = class {
    /** `onPick(point)`: a candidate was clicked; `onCamera(camera)`: the view was turned. */
    constructor(place, onPick, onCamera) {
      Object.assign(this, { place, onPick, onCamera, shape: null, camera: null, balls: [], under: null });
      let down = null;
      place.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; }, true);
      place.addEventListener("pointerup", (event) => {
        const still = down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < STILL;
        down = null;
        if (still && this.under) this.picked(this.under);
      }, true);
    }

    async show(shape, camera = null) {
      this.shape = shape;
      this.hover(null);
      this.camera = camera || this.fitted(shape);
      await Plotly.react(this.place, this.traces(), this.layout(), CONFIG);
      if (this.listening) return;
      this.listening = true;
      // Plotly's own click comes with every frame while a button is down, turns included: only what lies under the pointer is kept.
      for (const name of ["plotly_hover", "plotly_click"]) this.place.on(name, (event) => this.hover(event.points[0]));
      this.place.on("plotly_unhover", () => this.hover(null));
      for (const name of ["plotly_relayout", "plotly_relayouting"]) {
        this.place.on(name, (change) => {
          const turned = change["scene.camera"];
          if (!turned || this.following) return;
          this.camera = turned;
          this.onCamera(turned);
        });
      }
    }

    /** The first view: from as near as the panel shows the whole shape. */
    fitted(shape) {
      const { x, y, z } = columnsOf(shape.points), aspect = Math.max(this.place.clientWidth, 1) / Math.max(this.place.clientHeight, 1);
      const [sa, ca, se, ce] = [Math.sin(AZIMUTH), Math.cos(AZIMUTH), Math.sin(ELEVATION), Math.cos(ELEVATION)];
      let far = 0;
      for (let i = 0; i < x.length; i++) {
        const across = ca * x[i] - sa * y[i], toward = ce * (sa * x[i] + ca * y[i]) + se * z[i], up = ce * z[i] - se * (sa * x[i] + ca * y[i]);
        far = Math.max(far, toward + Math.max(Math.abs(up), Math.abs(across) / aspect) / SLOPE);
      }
      far *= MARGIN / (2 * REACH);   // plotly's unit of length is the shown cube's side
      return { eye: { x: far * ce * sa, y: far * ce * ca, z: far * se }, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } };
    }

    /** Size of candidates that leaves few gaps: nearer views draw them larger. */
    dot() {
      const { x, y, z } = this.camera.eye, near = this.place.clientHeight / Math.hypot(x, y, z);
      return Math.min(Math.max(near / 160, 2), 5);
    }

    async follow(camera) {
      if (!this.shape) return;
      this.camera = camera;
      this.following = true;
      await Plotly.relayout(this.place, { "scene.camera": camera });
      this.following = false;
    }

    /** `field`: see fields.js; `options`: { surface, points, labels, predicted, truth, lines, absent }; `marked`: candidates to mark. */
    async paint(field, attempt, options, marked) {
      const { shape } = this, surface = shape.surface, places = keypointPlaces(shape, attempt, options);
      const showPoints = options.points || !(surface && options.surface);
      const words = field.values ? Array.from(field.values, (v, i) => `point ${shape.indices[i]}: ${v.toFixed(3)}`) : Array.from(shape.indices, (i) => `point ${i}`);
      this.balls = places.predicted;
      const labelled = options.labels ? [...places.predicted, ...places.truth.filter((k) => !places.predicted.some((p) => p.id === k.id))] : [];
      const updates = {
        surface: surface ? { visible: options.surface, vertexcolor: showPoints ? null : Array.from(surface.nearest, (i) => field.colors[i]) } : {},
        points: { visible: showPoints, "marker.color": field.colors, hovertext: words },
        lines: columns(places.lines.map((k) => k.at)),
        truth: { ...columns(places.truth.map((k) => k.at)), hovertext: places.truth.map((k) => `annotated ${k.words}`) },
        predicted: b23d.balls(places.predicted, BALL),
        reference: b23d.balls(marked.map((i) => ({ at: shape.points.slice(3 * i, 3 * i + 3), color: "#ff2fd0", label: "clicked, or most like it" })), PICKED),
        labels: { ...columns(labelled.map((k) => lifted(k.at))), text: labelled.map((k) => k.label) },
      };
      const changes = {};   // one redraw: attribute → its value for each trace, undefined where a trace keeps its own
      TRACES.forEach((name, i) => Object.entries(updates[name]).forEach(([key, value]) => {
        changes[key] = changes[key] || Array(TRACES.length).fill(undefined);
        changes[key][i] = value;
      }));
      await Plotly.restyle(this.place, changes, TRACES.map((_, i) => i));
    }

    async theme() {
      if (this.shape) await this.show(this.shape, this.camera);
    }

    close() {
      if (this.shape) Plotly.purge(this.place);
      this.shape = null;
      this.listening = false;
    }

    hover(point) {
      this.under = point;
      this.place.dataset.under = point ? TRACES[point.curveNumber] : "";
    }

    picked(point) {
      const role = TRACES[point.curveNumber], { shape } = this;
      if (role === "points") this.onPick(point.pointNumber);
      else if (role === "surface") this.onPick(shape.surface.nearest[point.pointNumber]);
      else if (role === "truth") this.onPick(nearest(shape.points, shape.truth[point.pointNumber].at));
      else if (role === "predicted") this.onPick(nearest(shape.points, this.balls[b23d.ballOf(point.pointNumber)].at));
    }

    traces() {
      const { shape } = this, { surface } = shape, ink = b23d.theme.color("--text");
      const empty = { type: "scatter3d", x: [], y: [], z: [], showlegend: false };
      const light = { lighting: { ambient: 0.72, diffuse: 0.5, specular: 0.05, roughness: 0.9, facenormalsepsilon: 1e-16 }, lightposition: { x: 2000, y: 5000, z: 9000 } };
      const ball = { type: "mesh3d", x: [], y: [], z: [], i: [], j: [], k: [], hoverinfo: "text", ...light };
      return [
        surface
          ? { type: "mesh3d", ...columnsOf(surface.vertices), ...corners(surface.faces), color: "#aab1bb", flatshading: true, hoverinfo: "none", ...light }
          : { ...empty, mode: "markers" },
        { ...empty, ...columnsOf(shape.points), mode: "markers", hoverinfo: "text", marker: { size: this.dot(), line: { width: 0 }, color: "#888" } },
        { ...empty, mode: "lines", line: { color: "#dc2626", width: 5 }, hoverinfo: "skip" },
        { ...empty, mode: "markers", hoverinfo: "text", marker: { size: 9, symbol: "circle-open", color: ink, line: { width: 3, color: ink } } },
        { ...ball },
        { ...ball },
        { ...empty, mode: "text", textposition: "middle center", textfont: { size: 13, color: ink, weight: 700 }, hoverinfo: "skip" },
      ];
    }

    layout() {
      return {
        margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, font: { family: "inherit", size: 12 },
        hoverlabel: { bgcolor: b23d.theme.color("--card"), font: { color: b23d.theme.color("--text") } },
        scene: { xaxis: AXIS, yaxis: AXIS, zaxis: AXIS, aspectmode: "cube", dragmode: "turntable", camera: this.camera },
      };
    }
  };

  // Plotly's turntable turns about z, shapes stand on y: (x, y, z) is drawn at (x, -z, y).
  const columns = (places) => ({ x: places.map((p) => p && p[0]), y: places.map((p) => p && -p[2]), z: places.map((p) => p && p[1]) });
  b23d.columns = columns;

  function columnsOf(values) {
    const column = (axis, sign) => Float32Array.from({ length: values.length / 3 }, (_, i) => sign * values[3 * i + axis]);
    return { x: column(0, 1), y: column(2, -1), z: column(1, 1) };
  }

  function corners(faces) {
    const column = (corner) => Int32Array.from({ length: faces.length / 3 }, (_, i) => faces[3 * i + corner]);
    return { i: column(0), j: column(1), k: column(2) };
  }

  // Labels stand a little outside, where the surface does not hide them.
  function lifted(at) {
    const length = Math.hypot(...at) || 1;
    return Array.from(at, (x) => x + (LIFT * x) / length);
  }

  function keypointPlaces(shape, attempt, options) {
    const color = (id) => (id < 0 ? "#808080" : b23d.data.idColors[id % b23d.data.idColors.length]);
    const found = attempt ? attempt.keypoints.filter((k) => k.present || options.absent) : [];
    const truth = new Map(shape.truth.map((k) => [k.id, k]));
    const number = (id) => (id < 0 ? "" : String(id)), called = (id) => b23d.panel.called(shape, id);
    return {
      truth: options.truth ? shape.truth.map((k) => ({ id: k.id, at: k.at, label: number(k.id), words: called(k.id) })) : [],
      predicted: options.predicted
        ? found.map((k) => ({ id: k.id, at: k.at, label: k.present ? number(k.id) : `(${number(k.id)})`, words: called(k.id), color: color(k.id) })) : [],
      lines: options.lines ? found.filter((k) => truth.has(k.id)).flatMap((k) => [{ at: k.at }, { at: truth.get(k.id).at }, { at: null }]) : [],
    };
  }

  function nearest(points, at) {
    let best = 0, least = Infinity;
    for (let i = 0; i < points.length; i += 3) {
      const d = (points[i] - at[0]) ** 2 + (points[i + 1] - at[1]) ** 2 + (points[i + 2] - at[2]) ** 2;
      if (d < least) [best, least] = [i / 3, d];
    }
    return best;
  }
})();
