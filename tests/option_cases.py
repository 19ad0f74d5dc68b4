"""Small inputs for every stage, and for every option of every stage a setting beside which changing it changes what the
stage makes of them."""

from __future__ import annotations

import functools
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from b23d.pipeline.stage import load_stages
from b23d.schemas.artifact import Artifact
from b23d.schemas.external import External
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape, Source
from b23d.schemas.views import Views
from b23d.stages.datasets.procedural import Procedural
from tests import made_spheres, test_geodesic, test_posterior, test_reweight, test_score, test_transfer
from tests.made_features import cloud, labelled
from tests.made_shapes import ROUGH, xyz
from tests.made_tokens import noise, sampled

Make = Callable[[Any], Artifact]
RANDOM = np.random.default_rng(3)
COLOURED = trimesh.Trimesh(
    ROUGH.vertices, ROUGH.faces, vertex_colors=RANDOM.integers(0, 255, (len(ROUGH.vertices), 4)), process=False
)
HOLED = np.concatenate([trimesh.sample.sample_surface(ROUGH, 60, seed=1)[0], [[np.nan] * 3]])


@functools.cache
def stage(name: str) -> Any:
    return load_stages()[name]


def default(name: str) -> Any:
    return stage(name).params()


def normalized(params: Any, with_cloud: bool = True) -> NormalizedShape:
    """Of a mesh that lacks a face: one that is closed stays as it is where `watertight` is asked for."""
    torn = COLOURED.copy()
    torn.update_faces(np.arange(len(torn.faces)) > 0)
    files = {"m.ply": torn.export(file_type="ply"), "c.xyz": xyz(HOLED)}
    source = Source(shape="a/b", files=files, mesh="m.ply", cloud="c.xyz" if with_cloud else None)
    made: NormalizedShape = stage("normalize").function(source, params)
    return made


def with_outlier(params: Any) -> NormalizedShape:
    """Of a cloud that has one point far off."""
    points = np.concatenate([np.random.default_rng(0).normal(size=(1200, 3)), [[90.0, 0, 0]]])
    source = Source(shape="a/b", files={"c.xyz": xyz(points)}, cloud="c.xyz")
    made: NormalizedShape = stage("normalize").function(source, params)
    return made


@functools.cache
def mesh() -> NormalizedShape:
    return normalized(stage("normalize").params(count=64, candidates="fps"), with_cloud=False)


@functools.cache
def bare(count: int = 80) -> NormalizedShape:
    """A cloud in two pieces."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3)) * [0.3, 0.5, 1]
    points[: count // 2, 0] += 0.8
    return test_geodesic.shape(points)


@functools.cache
def views() -> Views:
    params = stage("render").params(rings={"count": 1}, resolution=56)
    found: Views = stage("render").function(sampled(ROUGH), params)
    return found


@functools.cache
def checkpoint(name: str) -> Path:
    from tests.tiny_checkpoints import save

    return save(name, Path(tempfile.mkdtemp()))


def extract(params: Any) -> Artifact:
    weights = checkpoint("sam" if params.encoder == "sam-vit-base" else "dinov2")
    made: Artifact = stage("extract").function(views(), params.model_copy(update={"weights": weights}))
    return made


def annotation_checked(params: Any) -> Artifact:
    """One keypoint of six lies off the surface."""
    unit = mesh().points[:6].astype(np.float64)
    unit[0] *= 1 + 0.06 / np.linalg.norm(unit[0])
    keypoints = Keypoints(
        ids=np.arange(6, dtype=np.int32),
        positions=mesh().to_source(unit),
        point_indices=np.full(6, -1, np.int32),
    )
    made: Artifact = stage("annotation").function(mesh(), keypoints, params)
    return made


def npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def import_features(params: Any) -> Artifact:
    points = bare().points[::2].astype(np.float64)
    data = npz(features=RANDOM.normal(size=(len(points), 4)) * 0 + np.arange(len(points))[:, None], points=points)
    file = External(shape="a/b", suffix=".npz", data=data)
    made: Artifact = stage("import_features").function(bare().model_copy(update={"scale": 1.05}), file, params)
    return made


def import_predictions(params: Any) -> Artifact:
    points, scores = bare().points[:9].astype(np.float64), np.linspace(1, 0, 9)
    suffix, data = ".npz", npz(points=points, scores=scores)
    if params.format == "sift3d-csv":
        rows = np.concatenate([points[:3] * 4, np.zeros((3, 1)), np.zeros((3, 10))], axis=1)
        suffix, data = ".csv", "\n".join(",".join(f"{x:.6f}" for x in row) for row in rows).encode()
    file = External(shape="a/b", suffix=suffix, data=data)
    shot = Keypoints(
        ids=np.arange(4, dtype=np.int32), positions=np.zeros((4, 3)), point_indices=np.arange(4, dtype=np.int32)
    )
    shape = bare().model_copy(update={"scale": 1.15})
    made: Artifact = stage("import_predictions").function(shape, file, [shot], params)
    return made


@functools.cache
def bumps() -> tuple[NormalizedShape, Any, Keypoints]:
    points = trimesh.sample.sample_surface(ROUGH, 400, seed=2)[0]
    shape = test_geodesic.shape(points / np.ptp(points, axis=0).max())
    at = np.arange(0, 400, 40, dtype=np.int32)
    keypoints = Keypoints(
        ids=np.arange(len(at), dtype=np.int32), positions=shape.points[at].astype(float), point_indices=at
    )
    return shape, stage("geodesic").function(shape, default("geodesic")), keypoints


def detected(params: Any) -> Artifact:
    shape, distances, keypoints = bumps()
    detector = stage("calibrate").function([shape], [distances], [keypoints], params)
    made: Artifact = stage("detect").function(shape, distances, detector, default("detect"))
    return made


def scored(params: Any) -> Artifact:
    truth = test_score.annotated([0, 1, 2], [10, 12, 40])
    made: Artifact = stage("score").function(
        test_score.line_shape(), test_score.predicted([0, 2], [10, 36]), truth, [truth], params
    )
    return made


def part_scored(params: Any) -> Artifact:
    points = bare().points.astype(np.float64)
    labels = (np.arange(len(points)) % 2).astype(np.int32)
    wrong = np.zeros_like(labels)
    carried = test_transfer.carried(RANDOM.normal(size=(len(points), 24)), [0], points)
    names = [*test_transfer.NAMES]
    found = carried.model_copy(update={"labels": wrong, "names": names})
    made: Artifact = stage("score_parts").function(cloud(points), found, labelled(points, labels, names), params)
    return made


def transferred(params: Any) -> Artifact:
    target = test_transfer.random_shape(7)[1] + np.random.default_rng(1).normal(0, 1, (150, 24)) + 3
    return test_transfer.carried(target, [0, 1], **dict(params))


@functools.cache
def annotated(seed: int, ids: tuple[int, ...] = (0, 2, 5, 9), at: tuple[int, ...] = (3, 50, 50, 180)) -> Any:
    token = np.random.default_rng(seed).normal(size=12)
    return made_spheres.labelled(seed, list(ids), list(at), token)


def columns() -> list[list[Any]]:
    shots = [annotated(0), annotated(2, (0, 2, 5), (3, 50, 50)), annotated(4, (0, 7), (10, 90))]
    return [list(column) for column in zip(*shots, strict=True)]


def head(train: Any, apply: Any) -> Artifact:
    found = stage("train_head").function(*columns(), train)
    made: Artifact = stage("apply_head").function(*annotated(5, (), ())[:3], found, apply)
    return made


@functools.cache
def solids(turned: bool) -> tuple[Any, list[Any]]:
    """A target and three shots for the posterior method; turned: none stands as another."""
    boxes = [test_posterior.box_cloud(seed, turn=turn if turned else 0.0) for seed, turn in enumerate((0.0, 1.2, 2.5))]
    target = test_posterior.box_cloud(7, turn=0.8 if turned else 0.0)
    noisy = np.random.default_rng(0).normal(0, 1.5, target[1].features.shape) + target[1].features
    for i in (1, 2):
        full = boxes[i][3]
        fewer = Keypoints(ids=full.ids[:6], positions=full.positions[:6], point_indices=full.point_indices[:6])
        boxes[i] = (*boxes[i][:3], fewer)
    return (target[0], target[1].model_copy(update={"features": noisy.astype(np.float16)}), *target[2:]), boxes


def taught(params: Any, turned: bool = False) -> Any:
    """The model of solid shots."""
    return stage("learn").function(*[list(c) for c in zip(*solids(turned)[1], strict=True)], params)


def solved(params: Any, turned: bool = False) -> Artifact:
    if params.method != "posterior":
        model = stage("learn").function(*columns(), default("learn"))
        made: Artifact = stage("optimize").function(*annotated(5, (), ())[:3], model, params)
        return made
    found: Artifact = stage("optimize").function(*solids(turned)[0][:3], taught(default("learn"), turned), params)
    return found


def solved_on_few(params: Any) -> Artifact:
    """A target of six candidates, five of which are wanted."""
    points, features, distances = made_spheres.sphere(5, n=6)
    target = made_spheres.shape_of(points), made_spheres.features_of(features), made_spheres.distances_of(distances)
    model = stage("learn").function(*columns(), default("learn"))
    made: Artifact = stage("optimize").function(*target, model, params)
    return made


def stood(params: Any) -> Artifact:
    shapes = Procedural(kind="procedural", classes=["chair"], count=2).shapes()
    sources, keypoints = ([shape.leaves[leaf].read() for shape in shapes] for leaf in ("source", "keypoints"))
    made: Artifact = stage("stand").function(sources, keypoints, params)
    return made


def oriented(params: Any) -> Artifact:
    source = Procedural(kind="procedural", classes=["chair"], count=3).shapes()[2].leaves["source"].read()
    made: Artifact = stage("orient").function(source, stood(stage("stand").params(count=128)), params)
    return made


MAKE: dict[str, Make] = {
    "annotation": annotation_checked,
    "apply_head": lambda params: head(stage("train_head").params(steps=20, absent="never"), params),
    "backproject": lambda params: stage("backproject").function(sampled(ROUGH), views(), noise(views()), params),
    "calibrate": detected,
    "describe": lambda params: stage("describe").function(mesh(), params),
    "extract": extract,
    "geodesic": lambda params: stage("geodesic").function(bare(), params),
    "import_features": import_features,
    "import_predictions": import_predictions,
    "learn": taught,
    "normalize": normalized,
    "optimize": solved,
    "orient": oriented,
    "render": lambda params: stage("render").function(mesh(), params),
    "reweight": lambda params: stage("reweight").function(*test_reweight.random_case(7), params),
    "score": scored,
    "score_parts": part_scored,
    "stand": stood,
    "train_head": lambda params: stage("train_head").function(*columns(), params),
    "transfer": transferred,
}
"""Stage → what it makes of its small inputs. `detect` has no options."""
