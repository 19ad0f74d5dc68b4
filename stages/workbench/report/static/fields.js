// What points are coloured by. Each field: { colors: ["rgb(…)"], values, low, high, label, map } for the n points of a shape.
"use strict";

(() => {
  // Nine stops each of matplotlib's perceptually uniform maps (CC0).
  const MAPS = {
    viridis: [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89], [253, 231, 37]],
    plasma: [[13, 8, 135], [76, 2, 161], [126, 3, 168], [169, 35, 149], [204, 71, 120], [229, 108, 92], [248, 149, 64], [253, 196, 39], [240, 249, 33]],
  };
  const UNSEEN = "rgb(232,62,140)";
  const BANDS = 10;   // alternate shades along a distance, so that its isolines are seen

  const css = (r, g, b) => `rgb(${Math.round(r)},${Math.round(g)},${Math.round(b)})`;

  function mapped(map, t) {
    const stops = MAPS[map], at = Math.min(Math.max(t, 0), 1) * (stops.length - 1), i = Math.min(Math.floor(at), stops.length - 2), f = at - i;
    return stops[i].map((low, c) => low + f * (stops[i + 1][c] - low));
  }

  function scalar(values, low, high, label, map, shade = () => 1) {
    const span = high - low || 1;
    const colors = Array.from(values, (value, i) => {
      const [r, g, b] = mapped(map, (value - low) / span), s = shade(value, i);
      return css(r * s, g * s, b * s);
    });
    return { colors, values, low, high, label, map };
  }

  // Points of a cloud are shaded here, a surface by its lights.
  const shading = (shape, i) => (shape.surface ? 1 : shape.shade[i] / 255);

  const plain = (shape) => ({ colors: Array.from({ length: shape.n }, (_, i) => css(...[184, 191, 204].map((c) => c * shading(shape, i)))), values: null });

  function pca(shape) {
    if (!shape.colors) return null;
    const colors = Array.from({ length: shape.n }, (_, i) => {
      const s = 0.6 + 0.4 * shading(shape, i);
      return css(shape.colors[3 * i] * s, shape.colors[3 * i + 1] * s, shape.colors[3 * i + 2] * s);
    });
    return { colors, values: null, label: "first three principal components of the class's features, as red, green and blue" };
  }

  function views(shape) {
    if (!shape.counts) return null;
    const field = scalar(shape.counts, 0, shape.counts.reduce((a, b) => Math.max(a, b), 1), "views that see the point", "viridis");
    const unseen = shape.observed.reduce((sum, seen, i) => { if (!seen) field.colors[i] = UNSEEN; return sum + (seen ? 0 : 1); }, 0);
    field.note = unseen ? `${unseen} of ${shape.n} points are seen by no view (pink)` : "every point is seen by some view";
    return field;
  }

  function geodesic(shape, point) {
    if (!shape.distances) return null;
    const step = shape.distances.largest / BANDS;
    return scalar(shape.distances.row(point), 0, shape.distances.largest, "geodesic distance, longest side = 1", "plasma",
      (value) => (Math.floor(value / step) % 2 ? 0.84 : 1));
  }

  function similarity(shape, vector) {
    if (!shape.features || shape.channels !== vector.length) return null;
    const values = new Float32Array(shape.n);
    for (let i = 0; i < shape.n; i++) {
      let sum = 0;
      for (let c = 0; c < vector.length; c++) sum += shape.features[i * vector.length + c] * vector[c];
      values[i] = sum;
    }
    return scalar(values, -0.2, 1, `feature similarity (cosine, first ${vector.length} components)`, "viridis");
  }

  const vectorOf = (shape, point) => shape.features && shape.features.slice(point * shape.channels, (point + 1) * shape.channels);
  const best = (values) => values.reduce((top, value, i) => (value > values[top] ? i : top), 0);
  const gradient = (map) => `linear-gradient(to right, ${MAPS[map].map(([r, g, b]) => css(r, g, b)).join(", ")})`;

  b23d.fields = { plain, pca, views, geodesic, similarity, vectorOf, best, gradient };
})();
