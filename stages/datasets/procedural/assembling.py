"""Assembly: parts put together to one shape, with keypoints and part labels; Model: the finished shape."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid


@dataclass(frozen=True)
class BuiltShape:
    """A finished shape. Up is +y, the front is -z (KeypointNet's convention: noses and seat fronts at -z); right is
    +x."""

    vertices: np.ndarray
    """float32 (v, 3)"""
    faces: np.ndarray
    """int32 (f, 3), counter-clockwise seen from outside"""
    colors: np.ndarray
    """uint8 (v, 3), sRGB"""
    face_labels: np.ndarray
    """int32 (f,), index into `part_names`"""
    part_names: list[str]
    keypoint_ids: np.ndarray
    """int32 (k,), ascending; index into the class's list of keypoint names"""
    keypoints: np.ndarray
    """float64 (k, 3) on the surface; every number is a float32 one, as the vertices are"""
    reflections: list[tuple[int, ...]]
    rotations: list[tuple[int, ...]]
    style: dict[str, str]
    """What was chosen, for people and for the tests of variation."""

    def centroids(self) -> np.ndarray:
        """The middle of every face: float64 (f, 3)."""
        return self.vertices.astype(np.float64)[self.faces].mean(1)

    def ply(self) -> bytes:
        """Binary little-endian PLY: float vertices with uchar colours, int faces."""
        vertex = np.empty(len(self.vertices), [("position", "<f4", 3), ("color", "u1", 3)])
        vertex["position"], vertex["color"] = self.vertices, self.colors
        face = np.empty(len(self.faces), [("count", "u1"), ("corners", "<i4", 3)])
        face["count"], face["corners"] = 3, self.faces
        header = [
            "ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}",
            *(f"property float {axis}" for axis in "xyz"), *(f"property uchar {c}" for c in ("red", "green", "blue")),
            f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", "",
        ]  # fmt: skip
        return "\n".join(header).encode() + vertex.tobytes() + face.tobytes()


@dataclass
class Assembly:
    """A shape while it is put together.

    `keypoint_names`, `part_names`: all of the class; an id or label is an index into them, whether present here or not.
    `colors`: part or tint name → "#rrggbb".
    """

    keypoint_names: tuple[str, ...]
    part_names: tuple[str, ...]
    colors: dict[str, str]
    style: dict[str, str]
    _solids: list[tuple[Solid, int, str]] = field(default_factory=list)
    _marks: dict[int, np.ndarray] = field(default_factory=dict)

    def add(self, part: str, *solids: Solid, tint: str = "") -> None:
        """Solids of one part; `tint` names their colour where it is not the part's."""
        self._solids += [(solid, self.part_names.index(part), self.colors[tint or part]) for solid in solids]

    def add_pair(self, part: str, *solids: Solid, tint: str = "") -> None:
        """Solids at the right, and their images at the left."""
        self.add(part, *solids, *(solid.mirrored() for solid in solids), tint=tint)

    def mark(self, name: str, position: np.ndarray) -> None:
        """A keypoint in the mirror plane x = 0."""
        self._marks[self.keypoint_names.index(name)] = position * np.array([0.0, 1.0, 1.0])

    def mark_pair(self, name: str, position: np.ndarray) -> None:
        """`right_<name>` at `position`, and `left_<name>` at its image."""
        self._marks[self.keypoint_names.index(f"right_{name}")] = position
        self._marks[self.keypoint_names.index(f"left_{name}")] = position * np.array([-1.0, 1.0, 1.0])

    def mark_at(self, name: str, position: np.ndarray) -> None:
        """A keypoint of its own, at either side."""
        self._marks[self.keypoint_names.index(name)] = position

    def finished(self, diagonal: float, turns: tuple[tuple[str, ...], ...] = ()) -> BuiltShape:
        """The shape, scaled so that its bounding box has this diagonal.

        `turns`: names of keypoints that one turn about y takes each to the next; those not present are left out whole.
        """
        vertices = np.concatenate([solid.vertices for solid, _, _ in self._solids])
        counts = [len(solid.vertices) for solid, _, _ in self._solids]
        offsets = np.cumsum([0, *counts[:-1]])
        scale = diagonal / np.linalg.norm(np.ptp(vertices, axis=0))
        ids = sorted(self._marks)
        colors = np.array([list(bytes.fromhex(color[1:])) for _, _, color in self._solids], np.uint8)
        return BuiltShape(
            vertices=(vertices * scale).astype(np.float32) + np.float32(0.0),  # + 0: a negated zero is written as zero
            faces=np.concatenate(
                [solid.faces + at for (solid, _, _), at in zip(self._solids, offsets, strict=True)]
            ).astype(np.int32),
            colors=np.repeat(colors, counts, axis=0),
            face_labels=np.concatenate(
                [np.full(len(solid.faces), label, np.int32) for solid, label, _ in self._solids]
            ),
            part_names=list(self.part_names),
            keypoint_ids=np.array(ids, np.int32),
            keypoints=(np.stack([self._marks[i] for i in ids]) * scale).astype(np.float32).astype(np.float64) + 0.0,
            reflections=self._orbits([(f"left_{n[6:]}", n) for n in self.keypoint_names if n.startswith("right_")]),
            rotations=self._orbits(turns),
            style=dict(self.style),
        )

    def _orbits(self, names: tuple[tuple[str, ...], ...] | list[tuple[str, str]]) -> list[tuple[int, ...]]:
        orbits = [tuple(map(self.keypoint_names.index, orbit)) for orbit in names]
        return sorted(orbit for orbit in orbits if all(i in self._marks for i in orbit))
