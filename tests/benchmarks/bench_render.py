"""Seconds to render and back-project a shape (62 views of 224², 16 × 16 tokens of 384 channels), and how far the
renderers agree.

`python tests/benchmarks/bench_render.py [MESH OR CLOUD …]` measures these files instead of eight procedural shapes,
each as it is and as a cloud of its candidates. CPU seconds of one thread tell what an idle machine would take; OpenGL's
are those of all of the driver's threads.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from b23d.schemas.shape import NormalizedShape, Source
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.datasets.procedural import Procedural
from b23d.stages.encoders.patches import foreground_patches, nearest_kept
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.render import RenderParams, render

Result = TypeVar("Result")
CLOUDS = {".pcd", ".xyz", ".npz"}


def sources(paths: list[str]) -> list[Source]:
    if not paths:
        leaves = [shape.leaves["source"] for shape in Procedural(kind="procedural", count=2).shapes()]
        return [leaf.load({}, leaf.values) for leaf in leaves]  # type: ignore[misc]
    return [source(Path(path)) for path in paths]


def source(path: Path) -> Source:
    role = "cloud" if path.suffix in CLOUDS else "mesh"
    beside = (
        {file.name: file.read_bytes() for file in path.parent.iterdir() if file.is_file()}
        if path.suffix == ".obj"
        else {}
    )
    return Source(shape=path.stem, files={**beside, path.name: path.read_bytes()}, **{role: path.name})


def as_cloud(shape: NormalizedShape) -> NormalizedShape:
    """The same shape, of which only the candidates are known."""
    without = {"vertex_colors": None, "face_uvs": None, "texture": None, "faces": np.zeros((0, 3), np.int32)}
    alone = {"kind": "cloud", "vertices": shape.points, "point_faces": np.full_like(shape.point_faces, -1)}
    return shape.model_copy(update={**without, **alone})


def timed(clock: Callable[[], float], work: Callable[[], Result], repeats: int = 3) -> tuple[float, Result]:
    """The least of some times, after one that does not count."""
    result, times = work(), []
    for _ in range(repeats):
        started = clock()
        result = work()
        times.append(clock() - started)
    return min(times), result


def agreement(a: Views, b: Views) -> str:
    in_a, in_b = a.face_ids >= 0, b.face_ids >= 0
    overlap = (in_a & in_b).sum(axis=(1, 2)) / (in_a | in_b).sum(axis=(1, 2))
    difference = np.abs(a.depth - b.depth)[in_a & in_b]
    levels = np.abs(a.images.astype(int) - b.images.astype(int))
    return (
        f"silhouette IoU {overlap.mean():.5f} (least {overlap.min():.4f}), depth differs by "
        f"{np.median(difference):.1e} (99.5 %: {np.quantile(difference, 0.995):.1e}), {(levels > 1).mean():.5f} of the "
        "pixels by more than one level"
    )


def bench(shape: NormalizedShape, name: str) -> None:
    by_rays, views = timed(time.thread_time, lambda: render(shape, RenderParams()))
    random = np.random.default_rng(0)
    kept = foreground_patches(views.face_ids, (16, 16))
    tokens = ViewTokens(
        tokens=random.normal(size=(kept.sum(), 384)).astype(np.float16),
        rows=nearest_kept(kept),
        kept=kept,
        encoder="random",
        weights="none",
    )
    back, features = timed(time.thread_time, lambda: backproject(shape, views, tokens, BackprojectParams()))
    print(
        f"{name:<32} {len(shape.vertices):7d} vertices {len(shape.faces):7d} faces: render (embree) {by_rays:.3f} s, "
        f"backproject {back:.3f} s; covers {(views.face_ids >= 0).mean():.2f}, {features.counts.mean():.1f} views a "
        f"point, {1 - features.observed.mean():.4f} unseen",
        flush=True,
    )
    try:
        wall, raster = timed(time.perf_counter, lambda: render(shape, RenderParams(renderer="pyrender")), 1)
        processor, _ = timed(time.process_time, lambda: render(shape, RenderParams(renderer="pyrender")), 1)
    except RuntimeError as error:
        print(f"{'':<32} {error}")
        return
    print(f"{'':<32} pyrender {wall:.2f} s wall, {processor:.2f} s CPU; {agreement(views, raster)}", flush=True)


if __name__ == "__main__":
    for item in sources(sys.argv[1:]):
        normalized = normalize(item, NormalizeParams())
        bench(normalized, item.shape)
        if normalized.kind == "mesh":
            bench(as_cloud(normalized), f"{item.shape} as a cloud")
