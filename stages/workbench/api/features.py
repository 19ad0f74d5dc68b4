"""`b23d.features`: descriptors of one shape, without a run file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.stages.datasets.given import CATEGORY, GivenShapes
from b23d.stages.workbench.api.arguments import encoder_of, places_of, store_of, texts_of

RUN_FILE = Path(__file__).with_name("given.toml")
NEIGHBOURS = 4
"""Candidates that a place's descriptor is interpolated from: they lie about .015 of the shape's size apart."""


@dataclass(frozen=True)
class DescribedShape:
    """A shape with descriptors at its candidates, and distances between them where they were asked for."""

    shape: NormalizedShape
    features: PointFeatures
    distances: np.ndarray | None = None
    """(n, n) along the surface, unit frame."""

    def at(self, points: np.ndarray) -> np.ndarray:
        """(n, channel) float32 at places (n, 3) of the unit frame, by inverse distance from the nearest candidates."""
        distance, near = cKDTree(self.shape.points).query(points, k=min(NEIGHBOURS, len(self.shape.points)))
        distance, near = (
            np.reshape(found, (len(points), -1 if len(points) else NEIGHBOURS)) for found in (distance, near)
        )
        weights = 1 / np.maximum(distance, 1e-9)
        weights /= weights.sum(axis=1, keepdims=True)
        values = self.features.features.astype(np.float32)
        found = np.zeros((len(points), values.shape[1]), np.float32)
        for k in range(near.shape[1]):  # one neighbour at a time: a million vertices need one array of theirs, not four
            found += weights[:, k, None].astype(np.float32) * values[near[:, k]]
        return found


def features(
    mesh: Any,
    points: np.ndarray | None = None,
    *,
    encoder: str | None = None,
    overrides: Iterable[str] = (),
    store: str | None = None,
) -> np.ndarray:
    """One descriptor per vertex: (v, channel) float32, in the mesh's own vertex order; of a cloud, per point.

    mesh: a path, a trimesh object, an open3d-style one (`.vertices` and `.triangles`, or `.points`), `(vertices,
    faces)` arrays, or points (n, 3). +y is up. points: (n, 3) places in the mesh's frame, for descriptors there instead
    of at the vertices. encoder: as `stages.extract.encoder`. overrides: as `--set`, "stages.render.rings.count=3".
    store: where what is made is kept and found again; None: "runs/.store", until `b23d gc`.

    It runs in this process. Descriptors are made at 2,048 points of the surface (`stages.normalize.count`), smoothed as
    the run file's would be, and interpolated. Raises FileNotFoundError, ValueError or TypeError where `mesh` is no
    shape or an option is not what it should be, and RuntimeError with the stage's own message where a stage fails.
    """
    wanted = None if points is None else places_of(points)
    (described,) = describe({"mesh": mesh}, encoder, overrides, store)
    where = described.shape.vertices if wanted is None else described.shape.to_unit(wanted)
    return described.at(where)


def describe(
    things: dict[str, Any],
    encoder: str | None = None,
    overrides: Iterable[str] = (),
    store: str | None = None,
    distances: bool = False,
) -> list[DescribedShape]:
    """Shapes with their descriptors (and mutual distances), of what `GivenShapes.of` takes; made where need be. Raises
    as `features`."""
    asked = ['outputs=["reweight", "geodesic"]'] if distances else []
    run = given_run(things, encoder, [*asked, *with_encoder(overrides, None)], store)
    report = run.execute(workers=0)
    if report.failures:
        raise RuntimeError("\n".join(_by_file(failure.error, things) for failure in report.failures))
    found = []
    for name in things:
        shape = run.artifact(f"{CATEGORY}/{name}", "normalize")
        made = run.artifact(f"{CATEGORY}/{name}", "reweight")
        assert isinstance(shape, NormalizedShape) and isinstance(made, PointFeatures)
        found.append(DescribedShape(shape, made, _distances(run, f"{CATEGORY}/{name}") if distances else None))
    return found


def _by_file(message: str, things: dict[str, Any]) -> str:
    """A stage's message that names the file as it was given, or else the argument."""
    for name, thing in things.items():
        path = Path(thing) if isinstance(thing, str | Path) else None
        beside = rf"(?:: {re.escape(path.name)}(?=: ))?" if path is not None else ""  # the reader's own name for it
        own = str(thing) if path is not None else name
        message = re.sub(rf"(?<![\w/]){CATEGORY}/{re.escape(name)}(?!\w){beside}", lambda _: own, message)  # noqa: B023
        if path is not None and own in message:  # named already
            message = message.replace(f" in {path.name}, got", ", got")
    return message


def _distances(run: Run, name: str) -> np.ndarray:
    found = run.artifact(name, "geodesic")
    assert isinstance(found, GeodesicDistances)
    return found.distances


def given_run(things: dict[str, Any], encoder: str | None, overrides: Iterable[str], store: str | None) -> Run:
    """The run over shapes that were handed over; its record lies beside the store's own files."""
    chosen = with_encoder(overrides, encoder)
    store = store_of(store)
    try:
        config = load_config(RUN_FILE, chosen)
    except RunFileError as error:  # nobody has written this run file: what was asked for is at fault
        message = str(error).replace(f"run file {RUN_FILE}: ", "")
        raise RunFileError(message.replace(f"--set stages.extract.encoder={encoder}: ", "")) from error
    run = Run(replace(config, dataset=GivenShapes.of(**things)), store_place(store))
    run.folder = Path(run.store.root if run.store.local else Path.cwd()) / ".given"
    return run


def with_encoder(overrides: Iterable[str], encoder: str | None) -> list[str]:
    """Overrides, and the encoder's. Raises TypeError where they are no texts."""
    named = texts_of("overrides", overrides, 'overrides=["stages.render.rings.count=3"]')
    return [*named, *([f"stages.extract.encoder={encoder}"] if encoder_of(encoder) is not None else [])]


def store_place(store: str | None) -> str:
    """The store of what has no run file of its own: "runs/.store" of the current folder, unless told otherwise;
    absolute, so that it stays where it is when the program moves on."""
    if store is not None and "://" in store:
        return store
    return str(Path("runs/.store" if store is None else store).expanduser().resolve())
