// Details of one shape: found in the page, or loaded from a file beside it, and unpacked into typed arrays.
"use strict";

(() => {
  const TYPES = {
    uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int16: Int16Array, int32: Int32Array, float32: Float32Array,
  };
  const NEAR = 3;              // landmarks that a point lies among
  const arrived = new Map();   // key → packed details
  const KEPT = 8;              // unpacked shapes kept: each holds a distance matrix
  const unpacked = new Map();  // key → promise of details

  // Files beside the page call this: pages opened from a disk may load scripts, but not fetch.
  b23d.arrive = (key, packed) => arrived.set(key, packed);

  b23d.load = (key) => {
    if (!unpacked.has(key)) {
      const promise = find(key).then(unpack);
      promise.catch(() => unpacked.delete(key));
      unpacked.set(key, promise);
      if (unpacked.size > KEPT) unpacked.delete(unpacked.keys().next().value);
    }
    return unpacked.get(key);
  };

  function find(key) {
    return new Promise((resolve, reject) => {
      const inside = document.getElementById(`details-${key}`), script = document.createElement("script");
      const address = `${encodeURIComponent(b23d.data.folder)}/${encodeURIComponent(key)}.js`;
      const settle = () => {
        script.remove();
        if (arrived.has(key)) resolve(take(key));
        else reject(new Error(`${decodeURIComponent(address)} is not of this page; make the report again`));
      };
      script.onload = settle;
      script.onerror = () => reject(new Error(`${decodeURIComponent(address)} is not beside this page; keep the folder with it, or make the report with --inline`));
      if (inside) script.textContent = inside.textContent;
      else script.src = address;
      document.head.append(script);
      if (inside) settle();
    });
  }

  function take(key) {
    const packed = arrived.get(key);
    arrived.delete(key);
    return packed;
  }

  async function unpack(packed) {
    const points = await places(packed.points);
    const [indices, shade, features, colors, counts, observed, distances, surface] = await Promise.all([
      array(packed.indices), array(packed.shade), array(packed.features), array(packed.colors), array(packed.counts),
      array(packed.observed), matrix(packed.distances), mesh(packed.surface, points),
    ]);
    const n = packed.points.steps.shape[0];
    return { ...packed, n, points, indices, shade, features: features && normalised(features, packed.features.shape[1]), channels: features ? packed.features.shape[1] : 0, colors, counts, observed, distances, surface };
  }

  async function array(packed) {
    if (!packed) return null;
    const bytes = Uint8Array.from(atob(packed.data), (character) => character.charCodeAt(0));
    return new TYPES[packed.dtype](await b23d.inflated(bytes).arrayBuffer());
  }

  async function places({ low, side, steps }) {
    const from = await array(steps);
    for (let i = 3; i < from.length; i++) from[i] += from[i - 3];   // each is stored as its difference from the one before
    return Float32Array.from(from, (step, i) => low[i % 3] + (step / 4095) * side);
  }

  // stages/workbench/report/distances.py: gradient-predicted lower triangle of landmarks in the order of a curve.
  async function matrix(packed) {
    if (!packed) return null;
    const [residuals, near, weights] = await Promise.all([array(packed.residuals), array(packed.near), array(packed.weights)]);
    const m = packed.landmarks, n = near.length / NEAR, levels = new Uint8Array(m * m);
    for (let i = 1, at = 0; i < m; i++) {
      let left = 0, corner = 0;
      for (let j = 0; j < i; j++) {
        const above = levels[(i - 1) * m + j];
        left = (residuals[at++] + left + above - corner) & 255;
        corner = above;
        levels[i * m + j] = left;
        levels[j * m + i] = left;
      }
    }
    const step = packed.largest / 255;
    const weighed = (point, value) => {   // over a point's landmarks
      let sum = 0;
      for (let k = NEAR * point; k < NEAR * (point + 1); k++) if (weights[k]) sum += (weights[k] / 255) * value(near[k]);
      return sum;
    };
    const row = (point) => {   // from one point to every point
      const from = Float32Array.from({ length: m }, (_, landmark) => weighed(point, (own) => levels[own * m + landmark]) * step);
      const found = Float32Array.from({ length: n }, (_, other) => weighed(other, (own) => from[own]));
      found[point] = 0;
      return found;
    };
    return { row, largest: packed.largest, method: packed.method };
  }

  /** Of each place the nearest point. */
  function nearest(places, points) {
    return Uint16Array.from({ length: places.length / 3 }, (_, place) => {
      const [x, y, z] = places.subarray(3 * place, 3 * place + 3);
      let best = 0, least = Infinity;
      for (let i = 0; i < points.length; i += 3) {
        const away = (points[i] - x) ** 2 + (points[i + 1] - y) ** 2 + (points[i + 2] - z) ** 2;
        if (away < least) [best, least] = [i / 3, away];
      }
      return best;
    });
  }

  async function mesh(packed, points) {
    if (!packed) return null;
    const [vertices, faces] = await Promise.all([places(packed.vertices), array(packed.faces)]);
    for (let i = 0, coming = 0; i < faces.length; i++) {   // stored: how far below the vertex that comes next
      faces[i] = coming - faces[i];
      if (faces[i] === coming) coming++;
    }
    return { vertices, faces, nearest: nearest(vertices, points), coarse: packed.coarse };
  }

  // Rows of bytes as vectors of length 1.
  function normalised(bytes, channels) {
    const features = Float32Array.from(bytes);
    for (let i = 0; i < features.length; i += channels) {
      let sum = 0;
      for (let c = 0; c < channels; c++) sum += features[i + c] ** 2;
      const scale = sum > 0 ? 1 / Math.sqrt(sum) : 0;
      for (let c = 0; c < channels; c++) features[i + c] *= scale;
    }
    return features;
  }
})();
