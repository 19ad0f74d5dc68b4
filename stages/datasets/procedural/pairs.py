"""Pairs: shapes that differ from one another in a known way, with a cloud of corresponding points each.

Point i of one is where point i of the other is: the same place on the same face. Their clouds are their candidates
(which `normalize` sees to), so that their artifacts compare row by row.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.dataset import Dataset, Leaf, Shape, dataset
from b23d.schemas.shape import Source

if TYPE_CHECKING:
    from b23d.stages.datasets.procedural.solids import Solid

Pair = Literal["cubes", "boxes", "bump", "stretch", "engines", "walk", "wave", "child", "graze"]
IDS: dict[Pair, tuple[str, str]] = {
    "cubes": ("in", "out"),
    "boxes": ("in", "out"),
    "bump": ("before", "after"),
    "stretch": ("before", "after"),
    "engines": ("before", "after"),
    "walk": ("standing", "walking"),
    "wave": ("standing", "waving"),
    "child": ("adult", "walking-child"),
    "graze": ("standing", "grazing"),
}
VERSION = 1
"""Raise it when the shapes change: it enters their addresses."""
DENSITY = 10


@dataset("pairs")
class Pairs(Dataset):
    kind: Literal["pairs"]
    pairs: list[Pair] = ["cubes", "bump", "stretch", "engines"]
    """cubes: isometric, one side dented in or out (the paper's example). boxes: the same, longer than the dent is high,
    so that both have one scale. bump: a smooth bump on a table's top. stretch: an airplane's rear body drawn out, its
    tail untouched. engines: an airplane's engines above its wings, not below. walk, wave: a person in
    two poses. child: a standing adult and a walking child. graze: a horse that stands, and that steps and grazes."""
    points: int = Field(2048, ge=8)

    def annotations_kept(self) -> str:
        return "its keypoints are exact by construction and have no file"

    def shapes(self) -> list[Shape]:
        """All shapes, named `cubes/in`, `cubes/out` …"""
        found = [self._shape(pair, name) for pair in set(self.pairs) for name in IDS[pair]]
        return sorted(found, key=lambda shape: shape.name)

    def _shape(self, pair: Pair, name: str) -> Shape:
        values = {
            "leaf": "source",
            "pair": pair,
            "which": IDS[pair].index(name),
            "points": self.points,
            "version": VERSION,
        }
        return Shape(name, pair, {"source": Leaf(load_source, values)})


def load_source(files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """The surface as OFF, and its points as NPZ."""
    from b23d.stages.geometry.sampling import farthest_points, place, surface_samples

    both = made(values["pair"])
    first, wanted = both[0], both[values["which"]]
    dense = surface_samples(first.vertices, first.faces, DENSITY * values["points"], np.random.default_rng(0))
    on = dense[farthest_points(dense.points, values["points"])]
    points = place(wanted.vertices, wanted.faces, on.faces, on.barycentrics.astype(np.float64)).points
    stream = io.BytesIO()
    np.savez(stream, points=points)
    name = f"{values['pair']}/{IDS[values['pair']][values['which']]}"
    return Source(
        shape=name, files={"mesh.off": _off(wanted), "cloud.npz": stream.getvalue()}, mesh="mesh.off", cloud="cloud.npz"
    )


def made(pair: Pair) -> tuple[Solid, Solid]:
    """Both shapes of a pair: one list of faces, two of vertices; in one frame, equal but where the pair differs, or
    in different poses."""
    from b23d.stages.datasets.procedural import changes, figures

    return {
        "cubes": changes.dented_cubes,
        "boxes": changes.dented_boxes,
        "bump": changes.bumped_table,
        "stretch": changes.stretched_airplane,
        "engines": changes.raised_engines,
        "graze": changes.grazing_horse,
        "walk": lambda: (figures.figure(), figures.figure(figures.WALKING)),
        "wave": lambda: (figures.figure(), figures.figure(figures.WAVING)),
        "child": lambda: (figures.figure(), figures.figure(figures.WALKING, figures.CHILD)),
    }[pair]()


def _off(solid: Solid) -> bytes:
    lines = [f"OFF\n{len(solid.vertices)} {len(solid.faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in solid.vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in solid.faces.tolist()]
    return ("\n".join(lines) + "\n").encode()
