// Details of one shape: found in the page, or loaded from a file beside it, and unpacked into typed arrays.
"use strict";

(() => {
  const TYPES = {
    uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int16: Int16Array, int32: Int32Array, float16: Uint16Array, float32: Float32Array,
  };
  const arrived = new Map();   // key → packed details
  const KEPT = 8;              // unpacked shapes kept: each holds a distance matrix of 4 MB
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
    const [points, indices, shade, features, colors, counts, observed, distances, surface] = await Promise.all([
      array(packed.points), array(packed.indices), array(packed.shade), array(packed.features), array(packed.colors), array(packed.counts),
      array(packed.observed), matrix(packed.distances), mesh(packed.surface),
    ]);
    if (features) normalise(features, packed.features.shape[1]);
    const n = packed.points.shape[0];
    return { ...packed, n, points, indices, shade, features, channels: features ? packed.features.shape[1] : 0, colors, counts, observed, distances, surface };
  }

  async function array(packed) {
    if (!packed) return null;
    const text = atob(packed.data);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const values = new TYPES[packed.dtype](await new Response(stream).arrayBuffer());
    return packed.dtype === "float16" ? Float32Array.from(values, half) : values;
  }

  function half(bits) {
    const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
    if (exponent === 0) return sign * fraction * 2 ** -24;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  }

  // stages/workbench/report/distances.py: gradient-predicted lower triangle of points in the order of a curve.
  async function matrix(packed) {
    if (!packed) return null;
    const [order, residuals] = await Promise.all([array(packed.order), array(packed.residuals)]);
    const n = order.length, levels = new Uint8Array(n * n);
    for (let i = 1, at = 0; i < n; i++) {
      let left = 0, corner = 0;
      for (let j = 0; j < i; j++) {
        const above = levels[(i - 1) * n + j];
        left = (residuals[at++] + left + above - corner) & 255;
        corner = above;
        levels[i * n + j] = left;
        levels[j * n + i] = left;
      }
    }
    const place = new Uint16Array(n);
    order.forEach((point, i) => { place[point] = i; });
    const step = packed.largest / 255;
    const row = (point) => Float32Array.from(place, (j) => levels[place[point] * n + j] * step);   // from one point to every point
    return { row, largest: packed.largest, method: packed.method };
  }

  async function mesh(packed) {
    if (!packed) return null;
    const [steps, faces, nearest] = await Promise.all([array(packed.vertices), array(packed.faces), array(packed.nearest)]);
    const vertices = Float32Array.from(steps, (step, i) => packed.low[i % 3] + (step / 65535) * packed.side);
    return { vertices, faces, nearest, coarse: packed.coarse };
  }

  function normalise(features, channels) {
    for (let i = 0; i < features.length; i += channels) {
      let sum = 0;
      for (let c = 0; c < channels; c++) sum += features[i + c] ** 2;
      const scale = sum > 0 ? 1 / Math.sqrt(sum) : 0;
      for (let c = 0; c < channels; c++) features[i + c] *= scale;
    }
  }
})();
