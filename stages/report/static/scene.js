// One 3D panel: a shape's points and surface, its keypoints, and what was clicked. Wraps a plotly figure.
"use strict";

(() => {
  const CAMERA = { up: { x: 0, y: 1, z: 0 }, eye: { x: 1.05, y: 0.75, z: -1.35 }, center: { x: 0, y: 0, z: 0 } };
  const HIDDEN = { visible: false, showspikes: false };
  const TRACES = ["surface", "points", "lines", "truth", "predicted", "reference"];   // their order is their index
  const CONFIG = { displayModeBar: false, responsive: true, scrollZoom: true };
  const BOTH = { true: true, false: false };

  b23d.Scene = class {
    /** `onPick(point)`: a candidate was clicked; `onCamera(camera)`: the view was turned. */
    constructor(place, onPick, onCamera) {
      Object.assign(this, { place, onPick, onCamera, shape: null, camera: CAMERA });
    }

    async show(shape) {
      this.shape = shape;
      await Plotly.react(this.place, this.traces(), this.layout(), CONFIG);
      if (this.listening) return;
      this.listening = true;
      this.place.on("plotly_click", (event) => this.picked(event.points[0]));
      for (const name of ["plotly_relayout", "plotly_relayouting"]) {
        this.place.on(name, (change) => {
          const camera = change["scene.camera"];
          if (!camera || this.following) return;
          this.camera = camera;
          this.onCamera(camera);
        });
      }
    }

    async follow(camera) {
      if (!this.shape) return;
      this.camera = camera;
      this.following = true;
      await Plotly.relayout(this.place, { "scene.camera": camera });
      this.following = false;
    }

    /** `field`: see fields.js; `options`: { surface, points, labels, predicted, truth, lines, absent }; `marked`: candidates to ring. */
    async paint(field, attempt, options, marked) {
      const { shape } = this, surface = shape.surface;
      const places = keypointPlaces(shape, attempt, options);
      const words = field.values ? Array.from(field.values, (v, i) => `point ${shape.indices[i]}: ${v.toFixed(3)}`) : Array.from(shape.indices, (i) => `point ${i}`);
      const showPoints = options.points || !surface;
      const updates = {
        surface: surface ? { visible: BOTH[options.surface], vertexcolor: [showPoints ? null : Array.from(surface.nearest, (i) => field.colors[i])] } : {},
        points: { visible: showPoints, "marker.color": [field.colors], hovertext: [words] },
        lines: coordinates(places.lines), truth: { ...coordinates(places.truth), text: [places.truth.map((k) => k.label)] },
        predicted: { ...coordinates(places.predicted), text: [places.predicted.map((k) => k.label)], "marker.color": [places.predicted.map((k) => k.color)] },
        reference: coordinates(marked.map((i) => ({ at: Array.from(shape.points.slice(3 * i, 3 * i + 3)) }))),
      };
      for (const name of ["truth", "predicted"]) updates[name].mode = options.labels ? "markers+text" : "markers";
      for (const [i, name] of TRACES.entries()) if (Object.keys(updates[name]).length) await Plotly.restyle(this.place, updates[name], [i]);
    }

    theme() {
      if (this.shape) Plotly.relayout(this.place, { "font.color": b23d.theme.color("--text"), "hoverlabel.bgcolor": b23d.theme.color("--card") });
    }

    close() {
      if (this.shape) Plotly.purge(this.place);
      this.shape = null;
      this.listening = false;
    }

    picked(point) {
      const role = TRACES[point.curveNumber], { shape } = this;
      if (role === "points") this.onPick(point.pointNumber);
      else if (role === "surface") this.onPick(shape.surface.nearest[point.pointNumber]);
      else if (role === "truth" || role === "predicted") this.onPick(nearest(shape.points, [point.x, point.y, point.z]));
    }

    traces() {
      const { shape } = this, surface = shape.surface, ink = b23d.theme.color("--text");
      const column = (values, axis) => Array.from({ length: values.length / 3 }, (_, i) => values[3 * i + axis]);
      const text = { mode: "markers+text", textposition: "top center", textfont: { size: 12, color: ink }, hoverinfo: "text" };
      const empty = { type: "scatter3d", x: [], y: [], z: [], showlegend: false };
      return [
        surface
          ? {
              type: "mesh3d", x: column(surface.vertices, 0), y: column(surface.vertices, 1), z: column(surface.vertices, 2),
              i: column(surface.faces, 0), j: column(surface.faces, 1), k: column(surface.faces, 2), color: "#aab1bb", flatshading: true, hoverinfo: "none",
              lighting: { ambient: 0.55, diffuse: 0.6, specular: 0.05 }, lightposition: { x: 300, y: 900, z: -600 },
            }
          : { ...empty, mode: "markers" },
        {
          ...empty, mode: "markers", hoverinfo: "text", marker: { size: 3.6, line: { width: 0 }, color: "#888" },
          x: column(shape.points, 0), y: column(shape.points, 1), z: column(shape.points, 2),
        },
        { ...empty, mode: "lines", line: { color: "#dc2626", width: 5 }, hoverinfo: "skip" },
        { ...empty, ...text, marker: { size: 11, symbol: "circle-open", color: ink, line: { width: 3, color: ink } }, textposition: "bottom center" },
        { ...empty, ...text, marker: { size: 9, color: "#888", line: { width: 1.5, color: "#fff" } } },
        { ...empty, mode: "markers", hoverinfo: "skip", marker: { size: 12, symbol: "cross", color: "#10d0a0", line: { width: 1, color: "#053" } } },
      ];
    }

    layout() {
      return {
        margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false,
        font: { color: b23d.theme.color("--text"), family: "inherit", size: 12 }, hoverlabel: { bgcolor: b23d.theme.color("--card") },
        scene: { xaxis: HIDDEN, yaxis: HIDDEN, zaxis: HIDDEN, aspectmode: "data", dragmode: "turntable", camera: this.camera },
      };
    }
  };

  function coordinates(places) {
    return { x: [places.map((p) => p.at && p.at[0])], y: [places.map((p) => p.at && p.at[1])], z: [places.map((p) => p.at && p.at[2])] };
  }

  function keypointPlaces(shape, attempt, options) {
    const color = (id) => (id < 0 ? "#808080" : b23d.data.idColors[id % b23d.data.idColors.length]);
    const found = attempt ? attempt.keypoints.filter((k) => k.present || options.absent) : [];
    const truth = new Map(shape.truth.map((k) => [k.id, k]));
    const name = (id) => (id < 0 ? "" : String(id));
    return {
      truth: options.truth ? shape.truth.map((k) => ({ at: k.at, label: name(k.id) })) : [],
      predicted: options.predicted ? found.map((k) => ({ at: k.at, label: k.present ? name(k.id) : `${name(k.id)} absent`, color: color(k.id) })) : [],
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
