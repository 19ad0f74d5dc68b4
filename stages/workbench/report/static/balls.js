// Keypoints as spheres: many in one mesh, so that a candidate at the centre does not cover its keypoint, and zooming enlarges them.
"use strict";

(() => {
  const AROUND = 12, RINGS = 7;   // corners of a ring, rings between the poles
  const ROOM = 64;   // balls that a mesh has faces for at least: see below
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

  /**
   * `places`: [{ at, color, label }] → attributes of a mesh3d trace.
   *
   * Between a change and the next frame, plotly looks up the face below the pointer in what was drawn before, and fails where the mesh
   * has lost it. So a mesh never has fewer faces than `ROOM` balls: what is missing are faces without area at its first corner.
   */
  b23d.balls = (places, radius) => {
    const none = new Array(Math.max(0, ROOM - places.length) * faces.length).fill(0);
    const corner = (which) => [...places.flatMap((_, p) => faces.map((face) => face[which] + p * unit.length)), ...none];
    const corners = places.length ? places.flatMap((place) => unit.map((u) => u.map((x, axis) => place.at[axis] + radius * x))) : [[0, 0, 0]];
    return {
      ...b23d.columns(corners), i: corner(0), j: corner(1), k: corner(2),
      vertexcolor: places.length ? places.flatMap((place) => unit.map(() => place.color)) : ["#000"],
      hovertext: places.flatMap((place) => unit.map(() => place.words ?? place.label)),
    };
  };

  /** Which place a vertex of that mesh belongs to. */
  b23d.ballOf = (vertex) => Math.floor(vertex / unit.length);
})();
