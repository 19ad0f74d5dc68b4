"""Annotations are checked against geometry: units, frames, axes, one keypoint off, indices; and what runs do then."""

from __future__ import annotations

import html
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.run import Run
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.annotation import AnnotationParams, annotation
from b23d.stages.normalize import NormalizeParams, normalize
from tests.shared_data import ROOT
from tests.small_runs import FAST, make_boxes

plug_in()


def chair() -> trimesh.Trimesh:
    """Something without any symmetry: a seat, a back, and one leg; neither at the origin nor of unit size."""
    parts = [
        ((1.2, 0.1, 0.8), (0.4, 0.7, 0.2)),
        ((1.2, 0.9, 0.1), (0.4, 1.2, -0.2)),
        ((0.1, 0.7, 0.12), (0.9, 0.3, 0.5)),
    ]
    boxes = []
    for extents, middle in parts:
        box = trimesh.creation.box(extents=extents)
        box.apply_translation(middle)
        boxes.append(box)
    return trimesh.util.concatenate(boxes)


def annotated(positions: np.ndarray, indices: Any = None) -> Keypoints:
    k = len(positions)
    return Keypoints(
        ids=np.arange(k, dtype=np.int32),
        positions=np.asarray(positions, np.float64),
        point_indices=np.full(k, -1, np.int32) if indices is None else np.asarray(indices, np.int32),
    )


@pytest.fixture(scope="module")
def mesh() -> NormalizedShape:
    source = Source(shape="chair/a", files={"mesh.ply": chair().export(file_type="ply")}, mesh="mesh.ply")
    return normalize(source, NormalizeParams(count=512))


def corners() -> np.ndarray:
    vertices = np.asarray(chair().vertices)
    return vertices[[0, 3, 5, 8, 11, 14, 17, 20]]


def cloud(points: np.ndarray) -> NormalizedShape:
    text = "\n".join(" ".join(map(repr, row)) for row in points.tolist()).encode()
    return normalize(Source(shape="chair/a", files={"cloud.xyz": text}, cloud="cloud.xyz"), NormalizeParams())


def check(positions: np.ndarray, shape: NormalizedShape, indices: Any = None, **params: float) -> Any:
    return annotation(shape, annotated(positions, indices), AnnotationParams(**params))


def test_keypoints_on_the_surface_pass_in_silence(mesh: NormalizedShape) -> None:
    points, _ = trimesh.sample.sample_surface(chair(), 60, seed=1)
    found = check(np.concatenate([points, corners()]), mesh)
    assert found.warnings == [] and (found.distances <= 0.02).all() and len(found.distances) == 68
    assert check(np.zeros((0, 3)), mesh).warnings == []


def test_distances_beyond_the_warning_are_exact() -> None:
    box = trimesh.creation.box(extents=(2, 1, 1)).subdivide()
    source = Source(shape="b/a", files={"mesh.ply": box.export(file_type="ply")}, mesh="mesh.ply")
    shape = normalize(source, NormalizeParams(count=64))
    at = np.array([[0.3, 0.5 + h, 0.1] for h in (0.0, 0.06, 0.1, 0.16)])
    found = check(at, shape)
    np.testing.assert_allclose(found.distances[1:], [0.03, 0.05, 0.08], atol=1e-6)
    (warning,) = found.warnings
    assert "keypoint 3 at (0.3, 0.66, 0.1), 0.08 longest sides away (3 of 4" in warning
    with pytest.raises(ValueError, match=r"keypoint 3 .* 0\.08 longest sides away.*raise stages\.annotation\.refuse"):
        check(at, shape, refuse=0.07)


FRAME = chair()
LOW, HIGH = FRAME.bounds
SIDE, MIDDLE = float((HIGH - LOW).max()), (LOW + HIGH) / 2
REACH = float(np.linalg.norm(np.asarray(FRAME.vertices) - MIDDLE, axis=1).max())
MISTAKES: dict[str, tuple[Callable[[np.ndarray], np.ndarray], str]] = {
    "millimetres": (lambda p: p * 1000, "scaled ×1000 "),
    "centimetres": (lambda p: p * 100, "scaled ×100 "),
    "inches": (lambda p: p / 0.0254, "scaled ×39.37 "),
    "feet": (lambda p: p / 0.3048, "scaled ×3.281 "),
    "metres of a shape in millimetres": (lambda p: p / 1000, "scaled ×0.001 "),
    "any factor": (lambda p: p * 7.3, "scaled ×7.3"),
    "y and z swapped": (lambda p: p[:, [0, 2, 1]], "axes y and z swapped"),
    "x and y swapped": (lambda p: p[:, [1, 0, 2]], "axes x and y swapped"),
    "z up": (lambda p: np.stack([p[:, 0], -p[:, 2], p[:, 1]], 1), "right as (x, z, -y)"),
    "mirrored": (lambda p: p * [-1, 1, 1], "x mirrored"),
    "unit box": (lambda p: (p - MIDDLE) / SIDE, "normalised to longest side 1"),
    "−1 … 1": (lambda p: 2 * (p - MIDDLE) / SIDE, "normalised to −1 … 1"),
    "0 … 1": (lambda p: (p - LOW) / SIDE, "normalised to 0 … 1"),
    "unit sphere": (lambda p: (p - MIDDLE) / REACH, "normalised to the unit sphere"),
    "diagonal": (lambda p: (p - MIDDLE) / np.linalg.norm(HIGH - LOW), "normalised to diagonal 1"),
    "offset": (lambda p: p + np.array([0.4, 0.9, -0.7]), "offset by (0.4, 0.9, -0.7)"),
    "far offset": (lambda p: p + np.array([40, 9, -70]), "offset by (40, 9, -70)"),
    "millimetres, z up": (lambda p: 1000 * np.stack([p[:, 0], -p[:, 2], p[:, 1]], 1), "scaled ×1000 "),
    "one off": (
        lambda p: np.concatenate([p[:1] + np.array([0, 0.6, 0.3]), p[1:]]),
        "the other 7 lie on it: this one alone",
    ),
    "nonsense": (lambda p: np.random.default_rng(0).normal(size=p.shape), "another shape's annotation"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("kind", ["mesh", "cloud"])
def test_mistakes_are_refused_with_their_cause(mistake: str, kind: str, mesh: NormalizedShape) -> None:
    make, words = MISTAKES[mistake]
    dense = np.asarray(trimesh.sample.sample_surface(chair(), 6000, seed=0)[0])
    shape = mesh if kind == "mesh" else cloud(np.concatenate([np.asarray(chair().vertices), dense]))
    with pytest.raises(ValueError, match=r"expected keypoints on the shape's surface, got keypoint \d+ at") as error:
        check(make(corners()), shape)
    assert words in str(error.value)
    assert check(corners(), shape).warnings == []


@pytest.mark.parametrize("place", [1e12, 1e160, -1e300])
def test_keypoints_at_no_place_at_all_are_refused_by_name(place: float, mesh: NormalizedShape) -> None:
    positions = corners()
    positions[3, 1] = place
    with pytest.raises(ValueError, match=r"got keypoint 3 at \(.*, more than 1e\+09 longest sides away; mend"):
        check(positions, mesh)


def test_a_known_mistake_is_refused_though_it_moves_little(mesh: NormalizedShape) -> None:
    """Scaled to longest side 1 about the shape's own middle: no keypoint is `refuse` away, yet all are wrong."""
    with pytest.raises(ValueError, match=r"normalised to longest side 1.*raise stages\.annotation\.warn"):
        check((corners() - MIDDLE) / SIDE, mesh, refuse=5.0)


def test_no_warning_is_put_off_beyond_the_refusal() -> None:
    """Else nothing would be refused at all."""
    AnnotationParams(warn=0.1, refuse=0.1)
    with pytest.raises(ValueError, match=r"expected at most refuse, 0\.1, got 0\.2; raise stages\.annotation\.refuse"):
        AnnotationParams(warn=0.2)


def test_point_indices_must_agree_with_positions() -> None:
    points = np.asarray(trimesh.sample.sample_surface(chair(), 2048, seed=0)[0])
    shape = cloud(points)
    chosen = np.array([5, 100, 2000, 7])
    assert check(points[chosen], shape, chosen).warnings == []
    with pytest.raises(ValueError, match=r"xyz .* away \(4 of 4 disagree\); likely point_index counts another"):
        check(points[chosen], shape, (chosen + 700) % 2048)
    with pytest.raises(ValueError, match="expected a point index below 2048, got 4000"):
        check(points[chosen], shape, [5, 100, 4000, 7])
    near = np.argsort(np.linalg.norm(points - points[5], axis=1))
    step = next(i for i in near if np.linalg.norm(points[i] - points[5]) / shape.scale > 0.09)
    (warning,) = check(points[chosen], shape, [step, 100, 2000, 7]).warnings
    assert "keypoint 0 where the cloud has point" in warning


def spoil(path: Path, change: Callable[[list[dict[str, Any]]], None]) -> None:
    file = path.parent / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    change(entries)
    file.write_text(json.dumps(entries))


def invoke(*arguments: str) -> tuple[int, str]:
    told = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})
    assert told.exception is None or isinstance(told.exception, SystemExit), told.exception
    return told.exit_code, " ".join(told.output.split())


def scale_up(entry: dict[str, Any]) -> None:
    for keypoint in entry["keypoints"]:
        keypoint["xyz"] = [1000 * c for c in keypoint["xyz"]]


def test_a_refused_annotation_costs_its_shape_nothing_else(tmp_path: Path) -> None:
    """Whichever shape it is: not a shot, not scored, and predicted."""
    path = make_boxes(tmp_path, 5)
    first = {shot.id for draw in Run.load(path).plan().draws for shot in draw.shots}
    bad = sorted(first)[0]
    spoil(path, lambda entries: [scale_up(e) for e in entries if e["model_id"] == bad and True])  # type: ignore[func-returns-value]
    status, told = invoke("run", str(path), "--workers", "0")
    assert status == 1 and f"annotation: ValueError: box/{bad}: expected keypoints" in told and "×1000" in told
    run = Run.load(path)
    (draw,) = run.plan().draws
    assert len(draw.shots) == 2 and bad not in {shot.id for shot in draw.shots}, "the next in rank takes its place"
    assert {shape.id for shape, _, _ in run.collect("optimize")} == {f"b{i}" for i in range(5)} - {
        s.id for s in draw.shots
    }
    assert bad not in {shape.id for shape, _, _ in run.collect("score")}
    assert invoke("run", str(path), "--workers", "0")[0] == 1, "said every time"
    path.write_text(path.read_text().replace("draws = [0]", f'draws = [0]\nids = {{box = ["{bad}"]}}'))
    status, told = invoke("run", str(path), "--workers", "0")
    assert status == 1 and f"got {bad} cannot be used; check shots.ids" in told


def test_a_warning_is_told_at_the_end_and_by_the_plan(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 4, extra=FAST + "[stages.annotation]\nrefuse = 0.5\n")

    def lift(entries: list[dict[str, Any]]) -> None:
        entries[0]["keypoints"][0]["xyz"][1] *= 1.8

    spoil(path, lift)
    for verb in ("run", "run", "plan"):
        status, told = invoke(verb, str(path), *(["--workers", "0"] if verb == "run" else []))
        assert status == 0, told
        assert "! box/b0: expected keypoints on the shape's surface, got keypoint 0" in told
        assert told.count("box/b0: expected") == 1
    assert invoke("report", str(path), "--out", str(tmp_path / "page.html"))[0] == 0
    page = html.unescape((tmp_path / "page.html").read_text())
    assert page.count("<li>box/b0: expected keypoints on the shape's surface, got keypoint 0") == 1


def features_only(path: Path) -> Path:
    """The run, without its stages that see shots; quick."""
    path.write_text('outputs = ["normalize"]\n' + path.read_text())
    return path


def test_what_is_wrong_with_shots_is_said_once(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    text = path.read_text()
    cases = {
        'draws = [0, 1, 2]\nids = {box = ["b0", "b9"]}': "b9 is not there; check shots.ids",
        'draws = [0, 1]\nids = {chair = ["b0"]}': "shots.ids: expected classes among box, got chair",
        "draws = [0, 1, 2, 3, 4]\ncount_ = 9": "expected 9 annotated shapes as shots, got 3",
    }
    for shots, words in cases.items():
        changed = text.replace("draws = [0]", shots)
        if "count_" in shots:
            changed = changed.replace("count = 2\n", "").replace("count_", "count")
        path.write_text(changed)
        status, told = invoke("plan", str(path))
        assert status == ("count_" not in shots) and told.count(words) == 1, told
    (tmp_path / "shapes" / "keypoints.json").rename(tmp_path / "shapes" / "box" / "annotated.json")
    path.write_text(text.replace("draws = [0]", "draws = [0, 1, 2]"))
    status, told = invoke("plan", str(path))
    assert status == 1 and told.count("annotations: expected keypoints in") == 1
    assert "box/annotated.json; move it there, or set dataset.keypoints" in told
    (tmp_path / "shapes" / "box" / "annotated.json").unlink()
    assert "no such file; annotate shapes with `b23d annotate`" in invoke("plan", str(path))[1]
    path.write_text(text.replace("draws = [0]", 'draws = [0]\nids = {box = ["b0", "b1"]}'))
    assert "b0 has no annotation, b1 has no annotation; check shots.ids" in invoke("plan", str(path))[1]
    assert invoke("plan", str(features_only(path)))[0] == 0, "features need no shots"


UNREADABLE = ("{", "[1, 2]", '{"a": 1}', "", "[]", '[{"model_id": "nowhere", "keypoints": []}]')


@pytest.mark.parametrize("said", UNREADABLE)
def test_an_annotation_file_of_no_use_stops_what_needs_annotations(tmp_path: Path, said: str) -> None:
    """plan foresees it, and so exits as run will; what needs no annotation goes through."""
    path, annotations = make_boxes(tmp_path, 3), tmp_path / "shapes" / "keypoints.json"
    annotations.write_text(said)
    for verb in (["plan"], ["plan", "--json"], ["run", "--workers", "0", "--until", "annotation"]):
        status, told = invoke(verb[0], str(path), *verb[1:])
        assert status == 1 and str(annotations) in told.replace("\n", ""), (verb, told)
    for verb in (["plan"], ["run", "--workers", "0"]):
        status, told = invoke(verb[0], str(path), *verb[1:], "--until", "normalize")
        assert status == 0 and str(annotations) not in told, (verb, told)


def test_one_bad_entry_of_an_annotation_file_leaves_the_plan_something_to_do(tmp_path: Path) -> None:
    path, annotations = make_boxes(tmp_path, 3), tmp_path / "shapes" / "keypoints.json"
    annotations.write_text(json.dumps([1, *json.loads(annotations.read_text())]))
    status, told = invoke("plan", str(path))
    assert status == 0 and f"{annotations} entry 0" in told


@pytest.mark.parametrize(
    ("case", "words"),
    [("keypoints-in-mm", "likely scaled ×1000"), ("keypoints-in-class-folder", "tables/keypoints.json; move it there")],
)
def test_the_cases(case: str, words: str, tmp_path: Path) -> None:
    if not (ROOT.parent / "cases" / case).exists():
        pytest.skip("needs the shared cases, which are not here")
    shutil.copytree(ROOT.parent / "cases" / case, tmp_path / "shapes")
    path = tmp_path / "run.toml"
    path.write_text(
        'name = "r"\noutputs = ["score"]\n[dataset]\nkind = "folder"\nroot = "shapes"\n'
        "[shots]\ncount = 2\ndraws = [0, 1]\n"
        f'[store]\nroot = "{tmp_path / "store"}"\n{FAST}'
    )
    status, told = invoke("run", str(path), "--workers", "0", "--until", "annotation")
    assert status == 1 and words in told, told
