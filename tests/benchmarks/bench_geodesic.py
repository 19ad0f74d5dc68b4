"""CPU seconds of geodesic, reweight and describe at 2,048 candidates, and geodesic's error on a sphere.

`python tests/benchmarks/bench_geodesic.py [MESH …]` measures these meshes instead of a sphere and a thin plate.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.stages.describe import DescribeParams, describe
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.geometry.sampling import farthest_points, surface_samples
from b23d.stages.reweight import ReweightParams, reweight

COUNT = 2048
CHANNELS = 384


def shape(vertices: np.ndarray, faces: np.ndarray) -> NormalizedShape:
    used = vertices[faces].reshape(-1, 3)
    low, high = used.min(axis=0), used.max(axis=0)
    vertices = (vertices - (low + high) / 2) / (high - low).max()
    samples = surface_samples(vertices, faces, 10 * COUNT, np.random.default_rng(0))
    chosen = samples[farthest_points(samples.points, COUNT)]
    return NormalizedShape(
        kind="mesh",
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        points=chosen.points,
        point_faces=chosen.faces,
        point_barycentrics=chosen.barycentrics,
        candidates="fps",
        center=(0.0, 0.0, 0.0),
        scale=1.0,
        repairs={},
    )


def cloud(of: NormalizedShape) -> NormalizedShape:
    bare = {"kind": "cloud", "faces": np.empty((0, 3), np.int32), "point_faces": np.full(COUNT, -1, np.int32)}
    return of.model_copy(update=bare)


def timed(work: Callable[[], object]) -> tuple[float, object]:
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


def sphere_error(points: np.ndarray, found: GeodesicDistances) -> str:
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    true = 0.5 * np.arccos(np.clip(unit @ unit.T, -1, 1))
    off = np.abs(found.distances[true > 0.05] / true[true > 0.05] - 1)
    return f"mean error {100 * off.mean():.2f} %, worst {100 * off.max():.1f} %"


def measure(name: str, of: NormalizedShape) -> None:
    print(f"{name}: {len(of.vertices)} vertices, {len(of.faces)} faces")
    for surface, on in (("mesh", of), ("cloud", cloud(of))):
        for params in ({}, {"graph": {"shortcuts": "cut"}}, {"method": "heat"}):
            seconds, found = timed(lambda on=on, params=params: geodesic(on, GeodesicParams(**params)))
            note = sphere_error(of.points, found) if name == "sphere" else f"{found.components.max() + 1} components"
            print(f"  geodesic {surface:<5} {params!s:<26} {seconds:6.2f} s  {note}")
        for descriptor in ("hks", "wks", "shot"):
            seconds, _ = timed(lambda on=on, descriptor=descriptor: describe(on, DescribeParams(descriptor=descriptor)))
            print(f"  describe {surface:<5} {descriptor:<26} {seconds:6.2f} s")
    random = np.random.default_rng(0)
    seen = random.random(COUNT) < 0.95
    features = PointFeatures(
        features=random.normal(size=(COUNT, CHANNELS)).astype(np.float16),
        counts=seen.astype(np.int32),
        observed=seen,
        descriptor="random",
    )
    seconds, _ = timed(lambda: reweight(features, found, ReweightParams()))
    print(f"  reweight {CHANNELS} channels {seconds:20.2f} s")


if __name__ == "__main__":
    import trimesh

    if sys.argv[1:]:
        for path in map(Path, sys.argv[1:]):
            mesh = trimesh.load(path, process=False, force="mesh")
            measure(path.name, shape(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    else:
        for name, mesh in (
            ("sphere", trimesh.creation.icosphere(subdivisions=4)),
            ("plate", trimesh.creation.box((1, 0.01, 1))),
        ):
            measure(name, shape(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
