"""`[dataset.damage]`: the shapes of a data set as bad scans of themselves, to measure what that costs.

Shots stay clean where `clean` says so, targets are damaged. Geometry alone is kept: colours, textures and what other
programs say of the clean shape are not. Of a shape with both, the mesh is damaged and the cloud dropped. Keypoints and
part labels follow the shape's pose; a keypoint whose surface is gone is absent from the truth.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from b23d.pipeline.dataset import Dataset, Leaf, Shape
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params, When
from b23d.schemas.parts import Parts
from b23d.schemas.shape import Source
from b23d.schemas.up_axis import to_y_up

if TYPE_CHECKING:
    from b23d.stages.datasets.damages.scan import Scan

Load = Callable[[dict[str, bytes], dict[str, Any]], Any]
VERSION = 2
"""Raise it when damages change: it enters the shapes' addresses."""
GONE = 0.02
"""A keypoint is absent where the surface nearest to it is farther off than before by more than this, in sizes."""
REMOVING = ("holes", "one-sided", "decimated")
RANDOM = ("noise", "holes", "uneven", "outliers", "flying", "soup", "shuffled", "decimated")

LEAST = {"decimated": 4.0, "uneven": 1.0, "scaled": 1e-6}
MOST = dict.fromkeys(("noise", "holes", "outliers", "flying", "soup", "shuffled"), 1.0)
"""What `amount` may be, where there is a limit; of holes, it has to be less."""


class ScanDamage(Params):
    """What is done to the shapes before anything else sees them; a size is the longest side of the clean shape."""

    kind: Literal[
        "none", "noise", "holes", "one-sided", "decimated", "uneven", "outliers", "flying", "soup", "shuffled",
        "turned", "scaled",
    ] = "none"  # fmt: skip
    """noise: along the normals. holes: balls cut out. one-sided: what one camera sees. decimated: few faces or points.
    uneven: points denser at the front. outliers: stray points in a box of three times the size. flying: stray points
    near the surface. soup: faces with vertices of their own. shuffled: a soup in random order, some faces wound the
    other way. turned: about the up axis. scaled: and moved."""
    amount: Annotated[float, When(kind=(*RANDOM, "one-sided", "turned", "scaled"))] = Field(0.0, ge=0)
    """noise: standard deviation, in sizes. holes: share of the surface. one-sided: degrees between front and camera.
    decimated: faces or points left. uneven: how many times denser. outliers, flying: share of the points or faces.
    soup: share of the faces torn off. shuffled: share wound the other way. turned: degrees. scaled: factor."""
    seed: Annotated[int, When(kind=RANDOM)] = Field(0, ge=0)
    """Of what is random; every shape has its own randomness besides."""
    points: int = Field(0, ge=0)
    """Take so many random points of each mesh for a cloud, before it is damaged; 0: meshes stay meshes. Clean shapes,
    too."""
    clean: int = Field(0, ge=0)
    """The first annotated shapes of each class, by name, that are not damaged: the data set's train split, all others
    its test split (`shots.split = "official"`). 0: all are damaged."""

    @model_validator(mode="after")
    def _possible(self) -> ScanDamage:
        low, high = LEAST.get(self.kind, 0.0), MOST.get(self.kind, float("inf"))
        if not low <= self.amount <= high or (self.kind == "holes" and self.amount == high):
            wanted = "below 1" if self.kind == "holes" else f"from {low:g} to {high:g}"
            wanted = f"of {low:g} or more" if high == float("inf") else wanted
            raise ValueError(
                f"damage.amount: expected one {wanted} for {self.kind!r}, got {self.amount:g}; "
                "set dataset.damage.amount"
            )
        return self

    def changes(self) -> bool:
        """Whether a shape is another than the data set's own."""
        return self.kind != "none" or self.points > 0

    def values(self) -> dict[str, Any]:
        """What a damaged leaf's digest has of it."""
        return {key: value for key, value in self.hashed().items() if key != "clean"} | {"version": VERSION}


class WithDamage(Dataset):
    """A data set whose shapes may be damaged."""

    damage: ScanDamage = ScanDamage()
    """The shapes as bad scans of themselves, to measure what that costs."""

    def listed(self) -> list[Shape]:
        """The shapes, all but the first `damage.clean` annotated ones of each class damaged. Raises as `shapes`."""
        shapes = super().listed()
        if self.damage == ScanDamage():
            return shapes
        spared: dict[str, int] = defaultdict(int)
        found = []
        for shape in shapes:
            clean = "keypoints" in shape.leaves and spared[shape.category] < self.damage.clean
            spared[shape.category] += clean
            applied = self.damage.model_copy(update={"kind": "none"}) if clean else self.damage
            split = {"official": "train" if clean else "test"} if self.damage.clean else {}
            found.append(replace(shape, leaves=_leaves(shape.leaves, applied), **split))
        return found


def _leaves(leaves: dict[str, Leaf], damage: ScanDamage) -> dict[str, Leaf]:
    """A shape's leaves under a damage; those of other programs are left out."""
    if not damage.changes() or "source" not in leaves:
        return leaves
    source, told = leaves["source"], damage.values()
    found = {
        "source": Leaf(
            partial(load_source, source.load), {"damage": told, "of": source.values}, source.files,
            {"context": source.context},
        )
    }  # fmt: skip
    for name, load in (("keypoints", load_keypoints), ("parts", load_parts)):
        if name in leaves:
            own = leaves[name]
            files = {f"{name}/{key}": path for key, path in own.files.items()}
            found[name] = Leaf(
                partial(load, own.load, source.load),
                {"damage": told, "of": own.values, "source": source.values},
                files | {f"source/{key}": path for key, path in source.files.items()},
                {"context": own.context, "source_context": source.context},
            )
    return found


def load_source(load: Load, files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """The damaged shape as a PLY. Raises ValueError, naming the shape, where the clean one cannot be read, cannot be
    damaged so, or nothing is left of it."""
    from b23d.stages.datasets.given import ply_bytes

    source: Source = load(files, {**values["of"], **values.get("context", {})})
    clean = clean_scan(source, values["damage"])
    try:
        scan = damaged_scan(clean, values["damage"])
    except ValueError as error:
        raise ValueError(f"{source.shape}: {error}") from error
    upright = to_y_up(source.up or "y")
    if not len(scan.vertices):
        raise ValueError(
            f"{source.shape}: expected something to be left of it, got nothing; choose another dataset.damage.amount"
        )
    role = "mesh" if len(scan.faces) else "cloud"
    data = ply_bytes(scan.vertices @ upright, scan.faces.astype(np.int32), None)
    return Source(shape=source.shape, files={f"{role}.ply": data}, **{role: f"{role}.ply"}, up=source.up)


def load_keypoints(load: Load, load_clean: Load, files: dict[str, bytes], values: dict[str, Any]) -> Keypoints:
    """The keypoints in the damaged shape's frame, but those whose surface is gone."""
    from b23d.stages.datasets.damages.moving import posed

    told = values["damage"]
    found: Keypoints = load(_below("keypoints", files), {**values["of"], **values.get("context", {})})
    source = _clean_source(load_clean, files, values)
    upright, kept = to_y_up(source.up or "y"), np.ones(len(found.ids), bool)
    positions = found.positions @ upright.T
    if told["kind"] in REMOVING:
        scan = clean_scan(source, told)
        if told["kind"] != "decimated" or len(scan.faces):  # fewer points are as much surface, fewer faces less
            kept = ~gone(positions, scan, damaged_scan(scan, told))
    left = set(found.ids[kept].tolist())
    return found.model_copy(update={
        "ids": found.ids[kept],
        "positions": posed(positions, told["kind"], told.get("amount", 0.0))[kept] @ upright,
        "point_indices": np.full(int(kept.sum()), -1, np.int32),
        "reflections": [orbit for orbit in found.reflections if left.issuperset(orbit)],
        "rotations": [orbit for orbit in found.rotations if left.issuperset(orbit)],
    })  # fmt: skip


def load_parts(load: Load, load_clean: Load, files: dict[str, bytes], values: dict[str, Any]) -> Parts:
    """The part labels in the damaged shape's frame."""
    from b23d.stages.datasets.damages.moving import posed

    told = values["damage"]
    found: Parts = load(_below("parts", files), {**values["of"], **values.get("context", {})})
    upright = to_y_up(_clean_source(load_clean, files, values).up or "y")
    return found.model_copy(
        update={"points": posed(found.points @ upright.T, told["kind"], told.get("amount", 0.0)) @ upright}
    )


def clean_scan(source: Source, told: dict[str, Any]) -> Scan:
    """A source's mesh, or else its cloud, upright; sampled where the damage asks for points. Raises ValueError with the
    shape's name."""
    from b23d.stages.datasets.damages.scan import Scan
    from b23d.stages.geometry.cleaning import fill_gaps, finite_rows
    from b23d.stages.geometry.loading import load
    from b23d.stages.geometry.sampling import surface_samples
    from b23d.stages.geometry.surface import Surface

    name = source.mesh if source.mesh is not None else source.cloud
    if name is None:
        raise ValueError(f"{source.shape}: expected a mesh or a cloud, got neither; add a file or remove the shape")
    loaded = load(source.shape, source.files, name, False, source.own_names)
    vertices = loaded.vertices if isinstance(loaded, Surface) else loaded.points
    faces = loaded.faces if isinstance(loaded, Surface) else np.zeros((0, 3), np.int64)
    if not finite_rows(vertices).any():
        raise ValueError(f"{source.shape}: expected finite coordinates, got none; mend or remove its file")
    scan = Scan(fill_gaps(vertices) @ to_y_up(source.up or "y").T, faces.astype(np.int64))
    scan = scan.of(np.arange(len(scan.places())))
    if not told["points"] or not len(scan.faces):
        return scan
    points = surface_samples(scan.vertices, scan.faces, told["points"], _random(scan, 0)).points
    return Scan(points.astype(np.float64), np.zeros((0, 3), np.int64))


def damaged_scan(scan: Scan, told: dict[str, Any]) -> Scan:
    """A clean scan under a damage's hashed values."""
    from b23d.stages.datasets.damages import adding, moving, removing, tearing
    from b23d.stages.datasets.damages.scan import Scan

    kind, amount = told["kind"], told.get("amount", 0.0)
    if kind in ("none", "turned", "scaled"):
        return Scan(moving.posed(scan.vertices, kind, amount), scan.faces)
    functions: dict[str, Callable[[Scan, float, np.random.Generator], Scan]] = {
        "noise": moving.noise, "uneven": moving.uneven, "holes": removing.holes, "one-sided": removing.one_sided,
        "decimated": removing.decimated, "outliers": adding.outliers, "flying": adding.flying, "soup": tearing.soup,
        "shuffled": tearing.shuffled,
    }  # fmt: skip
    return functions[kind](scan, amount, _random(scan, told.get("seed", 0)))


def gone(positions: np.ndarray, clean: Scan, left: Scan) -> np.ndarray:
    """(k,) bool: whether the surface at positions (k, 3) of the clean shape is missing from what is left of it."""
    from scipy.spatial import cKDTree

    size = clean.size
    before, after = (
        cKDTree(np.concatenate([part.vertices, part.places()])).query(positions)[0]
        for part in (clean.fine(GONE * size), left.fine(GONE * size))
    )
    return np.asarray(after - before > GONE * size)


def _random(scan: Scan, seed: int) -> np.random.Generator:
    """Other numbers for every shape and seed, the same on every machine."""
    digest = hashlib.sha256(f"{seed} ".encode() + scan.vertices.tobytes()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def _below(folder: str, files: dict[str, bytes]) -> dict[str, bytes]:
    prefix = f"{folder}/"
    return {name.removeprefix(prefix): data for name, data in files.items() if name.startswith(prefix)}


def _clean_source(load: Load, files: dict[str, bytes], values: dict[str, Any]) -> Source:
    source: Source = load(_below("source", files), {**values["source"], **values.get("source_context", {})})
    return source
