// One 3D panel: a shape, its keypoints as spheres with their ids, and the ray that a click sends into it. Wraps a plotly figure.
"use strict";

(() => {
  const AZIMUTH = 0.65, ELEVATION = 0.38;   // of the first view, radians from the front
  const SLOPE = Math.tan(Math.PI / 8);      // half of plotly's field of view
  const REACH = 0.58, SIDE = 2 * REACH;     // of the cube that is shown: shapes are centred, their longest side is 1; plotly's unit is that cube's side
  const BALL = 0.014, LIFT = 0.04, STILL = 4;   // unit frame; pixels between press and release of a click
  const AXIS = { visible: false, showspikes: false, range: [-REACH, REACH] };
  const EVERY_NORMAL = { facenormalsepsilon: 1e-16, vertexnormalsepsilon: 1e-16 };   // plotly drops small faces' normals: they were black
  const LIGHT = { lighting: { ambient: 0.6, diffuse: 0.55, specular: 0.05, roughness: 0.9, ...EVERY_NORMAL }, lightposition: { x: 2000, y: 5000, z: 9000 } };

  // Plotly's turntable turns about z, shapes stand on y: (x, y, z) is drawn at (x, -z, y).
  b23d.columns = (places) => ({ x: places.map((p) => p[0]), y: places.map((p) => -p[2]), z: places.map((p) => p[1]) });
  const fromPlotly = (v) => [v[0], v[2], -v[1]];
  const toPlotly = (v) => [v[0], -v[2], v[1]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const plus = (a, b, t = 1) => a.map((x, i) => x + t * b[i]);
  const normed = (a) => a.map((x) => x / (Math.hypot(...a) || 1));
  const vector = (v) => [v.x, v.y, v.z];

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const every = (values, place) => Array.from({ length: values.length / 3 }, (_, i) => values[3 * i + place]);

  b23d.View = class {
    /** `onClick(ray, event)`: pressed and released in one place; `onCamera(camera)`: turned or zoomed. */
    constructor(place, onClick, onCamera) {
      Object.assign(this, { place, onClick, onCamera, camera: null, shown: false, keypoints: [], mark: null });
      let press = null;
      this.tip = Object.assign(document.createElement("div"), { className: "tip", hidden: true });
      document.body.append(this.tip);
      place.addEventListener("pointermove", (event) => this.tell(event), true);
      place.addEventListener("pointerleave", () => { this.tip.hidden = true; });
      place.addEventListener("pointerdown", (event) => { press = event.button === 0 ? [event.clientX, event.clientY] : null; }, true);
      window.addEventListener("pointerup", (event) => {
        const still = press && Math.hypot(event.clientX - press[0], event.clientY - press[1]) <= STILL;
        press = null;
        if (still && this.shown) this.onClick(this.ray(event.clientX, event.clientY), event);
      }, true);
    }

    async show(shape, camera) {
      const vertices = new Float32Array(bytes(shape.vertices).buffer), faces = new Int32Array(bytes(shape.faces).buffer);
      const rgb = shape.colors && bytes(shape.colors);
      const colors = rgb && Array.from({ length: rgb.length / 3 }, (_, i) => `rgb(${rgb[3 * i]},${rgb[3 * i + 1]},${rgb[3 * i + 2]})`);
      const at = { x: every(vertices, 0), y: every(vertices, 2).map((z) => -z), z: every(vertices, 1) };
      const hidden = { hoverinfo: "skip", showlegend: false };
      this.surface = shape.kind === "mesh"
        ? { type: "mesh3d", ...at, i: every(faces, 0), j: every(faces, 1), k: every(faces, 2), ...hidden, ...LIGHT, flatshading: !colors,
          ...(colors ? { vertexcolor: colors } : { color: "#aab1bb" }) }
        : { type: "scatter3d", mode: "markers", ...at, ...hidden, marker: { size: vertices.length > 30000 ? 2 : 3.5, color: colors || "#8a93a1", line: { width: 0 } } };
      this.camera = camera || this.fitted(shape);
      await Plotly.react(this.place, this.traces(), this.layout(), { displayModeBar: false, responsive: true, scrollZoom: true, doubleClick: false });
      if (this.shown) return;
      this.shown = true;
      for (const name of ["plotly_relayout", "plotly_relayouting"]) {
        this.place.on(name, (change) => {
          const turned = change["scene.camera"];
          if (!turned || this.following) return;
          this.camera = turned;
          this.onCamera(turned);
        });
      }
    }

    /** `keypoints`: [{ id, unit, normal, color, told }], `mark`: the id to draw larger. */
    async paint(keypoints, mark) {
      Object.assign(this, { keypoints, mark });
      if (this.shown) await Plotly.react(this.place, this.traces(), this.layout(), this.place._context);
    }

    async follow(camera) {
      if (!this.shown) return;
      this.camera = camera;
      this.following = true;
      await Plotly.relayout(this.place, { "scene.camera": camera });
      this.following = false;
    }

    /** From as near as the panel shows the whole shape, and at least as far as another camera. */
    fitted(shape, other) {
      const vertices = new Float32Array(bytes(shape.vertices).buffer);
      const aspect = Math.max(this.place.clientWidth, 1) / Math.max(this.place.clientHeight, 1);
      const toward = [Math.cos(ELEVATION) * Math.sin(AZIMUTH), Math.sin(ELEVATION), Math.cos(ELEVATION) * Math.cos(AZIMUTH)];
      const right = normed(cross([0, 1, 0], toward)), up = cross(toward, right);
      let far = 0;
      for (let i = 0; i < vertices.length; i += 3) {
        const v = vertices.subarray(i, i + 3);
        far = Math.max(far, dot(v, toward) + Math.max(Math.abs(dot(v, up)), Math.abs(dot(v, right)) / aspect) / SLOPE);
      }
      const away = Math.max((1.1 * far) / SIDE, other ? Math.hypot(...vector(other.eye)) : 0);
      const [x, y, z] = toPlotly(toward.map((t) => away * t));
      return { eye: { x, y, z }, up: { x: 0, y: 0, z: 1 }, center: { x: 0, y: 0, z: 0 } };
    }

    /** Of the view: where it stands, what lies right, up and ahead, in plotly's axes. */
    stand() {
      const camera = this.place._fullLayout.scene._scene.getCamera();   // plotly's own events come late while a wheel turns
      const eye = vector(camera.eye), ahead = normed(plus(vector(camera.center), eye, -1));
      const right = normed(cross(ahead, vector(camera.up)));
      return { eye, ahead, right, up: cross(right, ahead), box: this.place.getBoundingClientRect() };
    }

    /** The ray through a place of the window: { origin, direction } in the unit frame. */
    ray(clientX, clientY) {
      const { eye, ahead, right, up, box } = this.stand();
      const across = ((2 * (clientX - box.left)) / box.width - 1) * SLOPE * (box.width / box.height);
      const above = (1 - (2 * (clientY - box.top)) / box.height) * SLOPE;
      const direction = plus(plus(ahead, right, across), up, above);
      return { origin: fromPlotly(eye.map((x) => x * SIDE)), direction: normed(fromPlotly(direction)) };
    }

    /** How far beside a ray a pixel lies, for each unit that it is away. */
    pixel() {
      return (2 * SLOPE) / this.place.getBoundingClientRect().height;
    }

    /** Name the keypoint under the pointer. */
    tell(event) {
      const over = this.shown && !event.buttons ? this.met(this.ray(event.clientX, event.clientY), Infinity) : null;
      this.tip.hidden = !over;
      if (!over) return;
      this.tip.textContent = over.told;
      this.tip.style.left = `${Math.max(4, Math.min(event.clientX + 12, window.innerWidth - this.tip.offsetWidth - 8))}px`;
      this.tip.style.top = `${event.clientY + 14}px`;
    }

    /** Where in the window a place (unit frame) is seen. */
    seenAt(unit) {
      const { eye, ahead, right, up, box } = this.stand();
      const v = plus(toPlotly(unit).map((x) => x / SIDE), eye, -1), depth = dot(v, ahead) * SLOPE;
      const x = (dot(v, right) / depth) * (box.height / box.width), y = dot(v, up) / depth;
      return [box.left + ((1 + x) / 2) * box.width, box.top + ((1 - y) / 2) * box.height];
    }

    /** The keypoint whose sphere a ray meets before it goes `limit` far, or null. */
    met(ray, limit) {
      let found = null, least = limit + BALL;
      for (const keypoint of this.keypoints) {
        const v = plus(keypoint.unit, ray.origin, -1), far = dot(v, ray.direction);
        if (Math.sqrt(Math.max(dot(v, v) - far * far, 0)) <= BALL && far < least) [found, least] = [keypoint, far];
      }
      return found;
    }

    traces() {
      const ink = b23d.theme.color("--text"), { keypoints, mark } = this, marked = keypoints.filter((k) => k.id === mark);
      const places = (list) => list.map((k) => ({ at: k.unit, color: k.color, label: String(k.id) }));
      const balls = (list, radius) => ({ type: "mesh3d", ...b23d.balls(places(list), radius), hoverinfo: "skip", ...LIGHT });
      return [
        this.surface,
        balls(keypoints.filter((k) => k.id !== mark), BALL),
        balls(marked, 1.7 * BALL),
        { type: "scatter3d", mode: "text", hoverinfo: "skip", showlegend: false, ...b23d.columns(keypoints.map((k) => plus(k.unit, k.normal || normed(k.unit), LIFT))),
          text: keypoints.map((k) => (k.id === mark ? `<b>${k.id}</b>` : String(k.id))), textfont: { color: ink, size: keypoints.map((k) => (k.id === mark ? 20 : 14)) } },
      ];
    }

    layout() {
      return {
        margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: false,
        scene: { xaxis: AXIS, yaxis: AXIS, zaxis: AXIS, aspectmode: "cube", dragmode: "turntable", hovermode: false, camera: this.camera },
      };
    }
  };
})();
