"""Every stage of one shape against its plain counterpart, and how much its CPU seconds grow with what it is given."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh

from b23d.pipeline.dataset import Leaf
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape, Source
from b23d.schemas.views import Views
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.datasets.procedural import Procedural
from b23d.stages.encoders.load import load_encoder
from b23d.stages.encoders.weights import find_checkpoint
from b23d.stages.extract import ExtractParams, extract
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.learn import learn
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.optimize import OptimizeParams, optimize
from b23d.stages.render import RenderParams, render
from b23d.stages.reweight import ReweightParams, reweight
from b23d.stages.score import ScoreParams, score
from b23d.stages.solvers.learn_options import LearnParams
from tests.benchmarks import plain
from tests.benchmarks.measuring import Table, in_a_process, seconds

ENCODERS = ("saliency-vit-s14", "efficientnet-lite0")
SHOTS = 3
Shot = tuple[NormalizedShape, PointFeatures, GeodesicDistances]
LARGE = 8
"""Subdivisions of an icosahedron: 1,310,720 faces."""


def shapes(count: int = 2) -> list[Source]:
    return [leaf.read() for leaf in _leaves("source", count)]  # type: ignore[misc]


def _leaves(name: str, count: int) -> list[Leaf]:
    return [shape.leaves[name] for shape in Procedural(kind="procedural", count=count).shapes()]


def encoder() -> str:
    """The transformer, where its package is installed."""
    for name in ENCODERS:
        try:
            find_checkpoint(name)
        except FileNotFoundError:
            continue
        return name
    raise FileNotFoundError(f"encoders: expected one of {', '.join(ENCODERS)}, got none installed; see the README")


def against_plain(table: Table) -> None:
    """CPU seconds of each stage over those of its plain counterpart, on one procedural chair."""
    table.title("CPU seconds of a stage, over those of its plain counterpart (2,048 points, 62 views of 224²)")
    name, total = encoder(), 0.0
    exact = load_encoder(find_checkpoint(name), precision="fp32")
    params = ExtractParams(encoder=name)
    sources = shapes(SHOTS + 1)
    annotations = [leaf.read() for leaf in _leaves("keypoints", SHOTS + 1)]
    source, truth = sources[0], annotations[0]
    own, shape = seconds(lambda: normalize(source, NormalizeParams()))
    render_time, views = seconds(lambda: render(shape, RenderParams()))
    extract_time, tokens = seconds(lambda: extract(views, params))
    back_time, features = seconds(lambda: backproject(shape, views, tokens, BackprojectParams()))
    path_time, distances = seconds(lambda: geodesic(shape, GeodesicParams()))
    weight_time, smooth = seconds(lambda: reweight(features, distances, ReweightParams()))
    shots = [_shot(one, params) for one in sources[1 : SHOTS + 1]]
    taught = [one for one in annotations[1 : SHOTS + 1] if isinstance(one, Keypoints)]
    assert isinstance(truth, Keypoints)
    learn_time, model = seconds(lambda: learn(*_columns(shots), taught, LearnParams()))
    find_time, found = seconds(lambda: optimize(shape, smooth, distances, model, OptimizeParams()))
    score_time, _ = seconds(lambda: score(shape, found, truth, taught, ScoreParams()))
    at = [keypoint_candidates(one, shot[0]) for one, shot in zip(taught, shots, strict=True)]
    seen = [
        (features, distances, one.ids, candidates)
        for (_, features, distances), one, candidates in zip(shots, taught, at, strict=True)
    ]
    learnt = plain.learn(seen)
    there = keypoint_candidates(truth, shape)
    thresholds = np.asarray(ScoreParams().thresholds)
    points = shape.points.astype(np.float64)
    pairs: list[tuple[str, float, Callable[[], Any]]] = [
        ("normalize", own, lambda: plain.normalize(shape.vertices, shape.faces)),
        ("render", render_time, lambda: plain.render(shape, views)),
        (f"extract, {name}", extract_time, lambda: plain.extract(views, exact)),
        ("backproject", back_time, lambda: plain.backproject(shape, views, tokens)),
        ("geodesic", path_time, lambda: plain.geodesic(points)),
        ("reweight", weight_time, lambda: plain.reweight(features, distances)),
        ("learn, 3 shots", learn_time, lambda: plain.learn(seen)),
        ("optimize", find_time, lambda: plain.optimize(learnt, smooth, distances)),
        ("score", score_time, lambda: plain.score(points, found.points, there, thresholds)),
    ]
    for stage, ours, work in pairs:
        theirs, _ = seconds(work, 1)
        total += 0 if stage.startswith("learn") else ours
        table.add(f"{stage} / plain", ours / theirs, f"{ours:.3f} s / {theirs:.3f} s")
    print(f"  {'all of them':<44} {total:8.3f}  s of CPU a shape; learn, once a draw, is not in it")


def _shot(source: Source, params: ExtractParams) -> Shot:
    shape = normalize(source, NormalizeParams())
    views = render(shape, RenderParams())
    features = backproject(shape, views, extract(views, params), BackprojectParams())
    distances = geodesic(shape, GeodesicParams())
    return shape, reweight(features, distances, ReweightParams()), distances


def _columns(shots: list[Shot]) -> tuple[list[NormalizedShape], list[PointFeatures], list[GeodesicDistances]]:
    return [one for one, *_ in shots], [one for _, one, _ in shots], [one for *_, one in shots]


def growth(table: Table) -> None:
    """Exponents: 1 is twice the time for twice the size."""
    table.title("Growth of CPU seconds: exponent over the sizes given")
    dense = shapes()[0]
    sizes = [512, 2048, 4096]
    found = {count: normalize(dense, NormalizeParams(count=count)) for count in sizes}
    _exponent(table, "normalize, points", sizes, lambda n: normalize(dense, NormalizeParams(count=n)))
    _exponent(table, "geodesic, points", sizes, lambda n: geodesic(found[n], GeodesicParams()))

    views = {rings: render(found[2048], RenderParams(rings={"count": rings})) for rings in (2, 5, 10)}
    by_count = {len(one.depth): one for one in views.values()}
    params = ExtractParams(encoder=encoder())
    tokens = {count: extract(one, params) for count, one in by_count.items()}

    def rings(count: int) -> Views:
        chosen = next(ring for ring, one in views.items() if len(one.depth) == count)
        return render(found[2048], RenderParams(rings={"count": chosen}))

    _exponent(table, "render, views", list(by_count), rings)
    _exponent(table, "extract, views", list(by_count), lambda n: extract(by_count[n], params))
    _exponent(
        table,
        "backproject, views",
        list(by_count),
        lambda n: backproject(found[2048], by_count[n], tokens[n], BackprojectParams()),
    )
    balls = {20 * 4**k: _ball(k) for k in (3, 5, 7)}
    normal = {count: normalize(ball, NormalizeParams()) for count, ball in balls.items()}
    _exponent(table, "normalize, faces", list(balls), lambda n: normalize(balls[n], NormalizeParams()))
    _exponent(table, "render, faces", list(balls), lambda n: render(normal[n], RenderParams()))


def large(table: Table) -> None:
    """Peak memory in a process of its own."""
    table.title("Large inputs: peak GB of a process that normalizes, renders and measures distances")
    for name, work in (("1.3M faces", large_mesh), ("1M points", large_cloud), ("16,384 candidates", candidates)):
        spent, peak = in_a_process(work)
        table.add(f"{name}, peak GB", peak, f"{spent:.1f} s of CPU")


def large_mesh() -> float:
    return _through(_ball(LARGE), 2048)


def large_cloud() -> float:
    points = np.random.default_rng(0).normal(size=(1_000_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    data = trimesh.PointCloud(points).export(file_type="ply")
    return _through(Source(shape="ball/cloud", files={"ball.ply": data}, cloud="ball.ply"), 2048)


def candidates() -> float:
    return _through(_ball(5), 16_384)


def _through(source: Source, count: int) -> float:
    def work() -> None:
        shape: NormalizedShape = normalize(source, NormalizeParams(count=count))
        render(shape, RenderParams())
        geodesic(shape, GeodesicParams())

    started = time.process_time()
    work()
    return time.process_time() - started


def _ball(subdivisions: int) -> Source:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Source(shape="ball/mesh", files={"ball.ply": mesh.export(file_type="ply")}, mesh="ball.ply")


def _exponent(table: Table, name: str, sizes: Sequence[int], work: Callable[[int], Any]) -> None:
    times = [seconds(lambda size=size: work(size), 1)[0] for size in sizes]  # type: ignore[misc]
    slope = np.polyfit(np.log(sizes), np.log(np.maximum(times, 1e-3)), 1)[0]
    table.add(name, float(slope), ", ".join(f"{size:,}: {time:.2f} s" for size, time in zip(sizes, times, strict=True)))
