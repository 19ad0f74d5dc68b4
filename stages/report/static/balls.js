// Keypoints as spheres: many in one mesh, so that a candidate at the centre does not cover its keypoint, and zooming enlarges them.
"use strict";

(() => {
  const AROUND = 12, RINGS = 7;   // corners of a ring, rings between the poles
  const unit = [[0, 1, 0]], faces = [];
  for (let ring = 1; ring <= RINGS; ring++) {
    const polar = (Math.PI * ring) / (RINGS + 1);
    for (let a = 0; a < AROUND; a++) {
      const angle = (2 * Math.PI * a) / AROUND;
      unit.push([Math.sin(polar) * Math.cos(angle), Math.cos(polar), Math.sin(polar) * Math.sin(angle)]);
    }
  }
  unit.push([0, -1, 0]);
  const at = (ring, a) => 1 + (ring - 1) * AROUND + (a % AROUND);
  for (let a = 0; a < AROUND; a++) {
    faces.push([0, at(1, a), at(1, a + 1)], [unit.length - 1, at(RINGS, a + 1), at(RINGS, a)]);
    for (let ring = 1; ring < RINGS; ring++) faces.push([at(ring, a), at(ring + 1, a), at(ring, a + 1)], [at(ring, a + 1), at(ring + 1, a), at(ring + 1, a + 1)]);
  }

  /** `places`: [{ at, color, label }] → attributes of a mesh3d trace. */
  b23d.balls = (places, radius) => {
    const corner = (which) => places.flatMap((_, p) => faces.map((face) => face[which] + p * unit.length));
    return {
      ...b23d.columns(places.flatMap((place) => unit.map((u) => u.map((x, axis) => place.at[axis] + radius * x)))),
      i: corner(0), j: corner(1), k: corner(2),
      vertexcolor: places.flatMap((place) => unit.map(() => place.color)), hovertext: places.flatMap((place) => unit.map(() => place.label)),
    };
  };

  /** Which place a vertex of that mesh belongs to. */
  b23d.ballOf = (vertex) => Math.floor(vertex / unit.length);
})();
