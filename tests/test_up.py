"""`dataset.up`: which axis of the files points up. Shapes are made upright; all that people give and get stays in the
file's own frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.schemas.shape import NormalizedShape, Source, turned
from b23d.schemas.up_axis import UP_AXES, UpAxis, axes_of, to_y_up
from b23d.stages.datasets.procedural import generated
from b23d.stages.geometry.upright import Stance
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.orienting.examples import ExampleShape, standing
from b23d.stages.workbench.annotate.geometry import Pickable
from b23d.stages.workbench.pictures.frames import original
from b23d.stages.workbench.results.columns import COLUMNS
from b23d.stages.workbench.results.gathering import Gathering
from tests.made_shapes import ROUGH, obj, xyz
from tests.small_runs import b23d, make_boxes

AXIS = {name: np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1) for name in UP_AXES}
LONG = ROUGH.vertices * (1.0, 3.0, 2.0) + 5


def toppled(points: np.ndarray, up: UpAxis) -> np.ndarray:
    """Of an upright shape, its file with `up` for the up axis."""
    return points @ to_y_up(up)


def made(points: np.ndarray, up: UpAxis, kind: str = "mesh", **params: object) -> NormalizedShape:
    files = {"m.obj": obj(points, ROUGH.faces)} if kind == "mesh" else {"m.xyz": xyz(points)}
    role = {"mesh": "m.obj"} if kind == "mesh" else {"cloud": "m.xyz"}
    return normalize(Source(shape="a/b", files=files, up=up, **role), NormalizeParams(count=64, **params))


@pytest.mark.parametrize("up", UP_AXES)
def test_the_axis_becomes_y_by_a_proper_rotation(up: UpAxis) -> None:
    rotation = to_y_up(up)
    np.testing.assert_array_equal(rotation @ AXIS[up], [0, 1, 0])
    np.testing.assert_array_equal(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == 1


def test_z_up_is_as_programs_export_it() -> None:
    np.testing.assert_array_equal(to_y_up("z") @ [1, 2, 3], [1, 3, -2])
    np.testing.assert_array_equal(to_y_up("y"), np.eye(3))


@pytest.mark.parametrize("up", UP_AXES)
@pytest.mark.parametrize("kind", ["mesh", "cloud"])
@pytest.mark.parametrize("turn", [0.0, 77.0])
def test_a_toppled_file_gives_the_upright_shape_and_places_go_there_and_back(
    up: UpAxis, kind: str, turn: float
) -> None:
    plain, shape = made(LONG, "y", kind, turn=turn), made(toppled(LONG, up), up, kind, turn=turn)
    assert shape.up == up and shape.turn == turn
    np.testing.assert_allclose(shape.vertices, plain.vertices, atol=1e-6)
    np.testing.assert_allclose(shape.points, plain.points, atol=1e-6)
    np.testing.assert_array_equal(shape.faces, plain.faces)
    file = toppled(LONG, up)
    np.testing.assert_allclose(shape.to_unit(file), shape.vertices, atol=1e-6)
    np.testing.assert_allclose(shape.to_source(shape.vertices.astype(float)), file, atol=1e-5)
    np.testing.assert_allclose(shape.to_source(shape.to_unit(file)), file, atol=1e-12)


def test_vertices_that_no_face_uses_may_be_anywhere() -> None:
    stray = np.concatenate([LONG, [[np.inf, 0, np.nan]]])
    assert np.isfinite(made(toppled_finite(stray), "z", max_nonfinite=0.5).vertices).all()


def toppled_finite(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    return np.stack([x, -z, y], 1)


@pytest.mark.parametrize("up", UP_AXES)
def test_a_click_on_an_upright_picture_lands_in_the_file_s_frame(up: UpAxis) -> None:
    box = trimesh.creation.box((1, 3, 2))
    file = toppled(box.vertices, up)
    pickable = Pickable.load(Source(shape="a/b", files={"m.obj": obj(file, box.faces)}, mesh="m.obj", up=up))
    drawn = pickable.drawing()[0]
    assert np.ptp(drawn, axis=0) == pytest.approx([1 / 3, 1, 2 / 3], abs=1e-5), "shown upright"
    hit = pickable.hit([0.01, 9.0, 0.02], [0.0, -1.0, 0.0])
    assert hit is not None and np.asarray(hit.unit)[1] == pytest.approx(0.5)
    assert np.asarray(hit.xyz) @ AXIS[up] == pytest.approx(1.5), "the top, in the file"
    assert hit.normal == pytest.approx([0, 1, 0])


NAMES = [("chair", "a"), ("chair", "old-1"), ("chair", "old-2"), ("table", "a")]


def test_the_most_specific_of_a_table_wins() -> None:
    table: dict[str, UpAxis] = {"*": "-z", "chair": "z", "chair/old-*": "x", "chair/old-2": "-y"}
    assert list(axes_of(table, NAMES).values()) == ["z", "x", "-y", "-z"]
    assert list(axes_of({"chair": "z"}, NAMES).values()) == ["z", "z", "z", "y"]
    assert axes_of({"b[1]": "x"}, [("b[1]", "a")]) == {("b[1]", "a"): "x"}, "a class is no pattern"


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"chiar": "z"}, "got 'chiar'; did you mean 'chair'"),
        ({"chair/old-9": "z"}, "got 'chair/old-9'; did you mean 'chair/old-2'"),
        ({"sofas-of-mine": "z"}, "its classes are chair, table"),
        ({"chair/?": "z", "*hair/a": "x"}, "expected one axis for chair/a, got *hair/a = x and chair/? = z"),
    ],
)
def test_a_table_that_cannot_be_followed_helps(table: dict[str, UpAxis], told: str) -> None:
    with pytest.raises(ValueError, match=r"dataset\.up: expected") as raised:
        axes_of(table, NAMES)
    assert told in str(raised.value)


@pytest.fixture
def boxes(tmp_path: Path) -> Path:
    return make_boxes(tmp_path)


def sources(path: Path, *overrides: str) -> dict[str, str]:
    """Of each shape, the address of its source."""
    plan = Run.load(path, overrides).plan()
    return {
        name: node.inputs["source"].recipe for (stage, name, _), node in plan.by_shape.items() if stage == "normalize"
    }  # type: ignore[union-attr]


def test_addresses_change_where_up_is_not_y_and_nowhere_else(boxes: Path) -> None:
    plain = sources(boxes)
    assert sources(boxes, "dataset.up=y") == plain == sources(boxes, 'dataset.up={"box" = "y"}')
    assert sources(boxes, "dataset.up=z").items().isdisjoint(plain.items())
    one = sources(boxes, 'dataset.up={"box/b1" = "z"}')
    assert {name for name in plain if one[name] != plain[name]} == {"box/b1"}
    assert one["box/b1"] == sources(boxes, "dataset.up=z")["box/b1"]


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("dataset.up=up", r"--set dataset.up=up: up: expected one of y, z, .*, got 'up'; mend"),
        ("dataset.up={box = 3}", r"up.box: expected one of y, z, .*, got 3; mend"),
        ("dataset.up=[1]", r"up: expected one of .*, got \[1\]; mend"),
    ],
)
def test_an_axis_that_is_none_is_one_line(boxes: Path, override: str, told: str) -> None:
    with pytest.raises(RunFileError, match=told) as raised:
        Run.load(boxes, [override])
    assert "\n" not in str(raised.value)


def test_a_z_up_folder_gives_the_keypoints_of_the_y_up_one_in_its_own_frame(tmp_path: Path) -> None:
    import pandas as pd

    tables = []
    for name, up in (("plain", "y"), ("tipped", "z")):
        (folder := tmp_path / name).mkdir()
        path = make_boxes(folder)
        for file in (folder / "shapes" / "box").iterdir():
            mesh = trimesh.load(file, process=False)
            mesh.vertices = toppled(mesh.vertices, up)  # type: ignore[arg-type]
            mesh.export(file)
        listed = folder / "shapes" / "keypoints.json"
        entries = json.loads(listed.read_text())
        for entry in entries:
            for keypoint in entry["keypoints"]:
                keypoint["xyz"] = toppled(np.array(keypoint["xyz"]), up).tolist()  # type: ignore[arg-type]
        listed.write_text(json.dumps(entries))
        assert Run.load(path, [f"dataset.up={up}"]).execute(workers=0).ok
        out = folder / "k.csv"
        b23d("keypoints", str(path), "--set", f"dataset.up={up}", "-o", str(out))
        tables.append(pd.read_csv(out))
        exported = folder / "b0.ply"
        b23d("show", str(path), "box/b0", "normalize", "--set", f"dataset.up={up}", "--export", str(exported))
        mesh, file_mesh = (trimesh.load(p, process=False) for p in (exported, folder / "shapes" / "box" / "b0.ply"))
        np.testing.assert_allclose(mesh.bounds, file_mesh.bounds, atol=0.05)
    plain, tipped = (table[["x", "y", "z"]].to_numpy() for table in tables)
    np.testing.assert_allclose(tipped, toppled(plain, "z"), atol=1e-5)
    assert tables[0]["id"].tolist() == tables[1]["id"].tolist()


def chairs(folder: Path, ups: list[UpAxis], annotated: bool = True) -> Path:
    """A folder of chairs, each turned and then toppled onto its own axis, and its run file."""
    rng = np.random.default_rng(0)
    (folder / "all" / "chair").mkdir(parents=True)
    entries = []
    for i, up in enumerate(ups):
        built = generated("chair", 0, i)
        motion = turned(float(rng.uniform(0, 360))).T @ to_y_up(up)
        trimesh.Trimesh(built.vertices @ motion, built.faces, process=False).export(folder / "all/chair" / f"{i}.ply")
        places = built.keypoints @ motion
        listed = [
            {"xyz": at, "semantic_id": k} for k, at in zip(built.keypoint_ids.tolist(), places.tolist(), strict=True)
        ]
        entries.append({"model_id": str(i), "keypoints": listed})
    if annotated:
        (folder / "all" / "keypoints.json").write_text(json.dumps(entries))
    path = folder / "all.toml"
    head = (
        f'name = "all"\noutputs = ["normalize"]\n[shots]\ncount = 3\ndraws = [0, 1]\n[store]\nroot = "{folder}/store"\n'
    )
    path.write_text(f'{head}[dataset]\nkind = "folder"\nroot = "all"\nup = "auto"\n')
    return path


UPS: list[UpAxis] = ["y", "z", "-x", "-y", "-z", "x", "z"]


def test_toppled_shapes_are_set_upright_by_what_the_examples_say(tmp_path: Path) -> None:
    path = chairs(tmp_path, UPS)
    run = Run.load(path)
    plan = run.plan()
    assert len({n.recipe for n in plan.nodes.values() if n.stage == "stand"}) == 1, "once a class, whatever the draw"
    assert run.execute(workers=0).ok
    for i, up in enumerate(UPS):
        shape = run.artifact(f"chair/{i}", "normalize")
        assert shape.up == up == run.artifact(f"chair/{i}", "orient").axis
        row = Gathering(run).entry(run.shapes[i])
        assert next(c for c in COLUMNS if c.key == "up").value(row) == run.artifact(f"chair/{i}", "orient").probability
        replaced = shape.model_copy(update={"repairs": {"watertight_faces": 1}})
        np.testing.assert_array_equal(original(run, f"chair/{i}", replaced).vertices, shape.vertices)
        file = trimesh.load(tmp_path / "all/chair" / f"{i}.ply", process=False).vertices
        np.testing.assert_allclose(shape.to_source(shape.vertices.astype(float)), file, atol=1e-5)


def test_what_one_example_declares_goes_for_all(tmp_path: Path) -> None:
    path = chairs(tmp_path, ["y", "y", "z", "y"])
    declared = 'dataset.up={"*" = "auto", "chair/0" = "-y", "chair/1" = "-y"}'
    run = Run.load(path, ["shots.ids.chair=['0', '1', '2']", declared])
    assert run.execute(workers=0).ok
    assert run.artifact("chair/0", "stand").by == "declared"
    assert [run.artifact(f"chair/{i}", "normalize").up for i in range(4)] == ["-y", "-y", "-z", "-y"]


def test_the_decision_counts_and_not_how_it_came_about(tmp_path: Path) -> None:
    path = chairs(tmp_path, ["y", "z", "y", "-y", "y"])
    outputs = 'outputs=["geodesic"]'
    assert Run.load(path, [outputs]).execute(workers=0).ok
    report = Run.load(path, [outputs, "stages.orient.turns=36"]).execute(workers=0)
    assert {outcome.stage for outcome in report.done} == {"orient", "normalize"}, "nothing below is made again"


def test_without_annotations_undersides_say_it_and_that_is_told(tmp_path: Path) -> None:
    run = Run.load(chairs(tmp_path, ["z", "z"], annotated=False))
    report = run.execute(workers=0)
    assert report.ok and len(report.warnings) == 2
    assert all("no shape of its class is annotated" in line for line in report.warnings)


def test_a_run_that_is_not_auto_has_no_stage_more(boxes: Path) -> None:
    assert {"orient", "stand"}.isdisjoint(Run.load(boxes).config.stages)
    auto = Run.load(boxes, ['dataset.up={"box/b1" = "auto"}'])
    plan, plain = auto.plan(), Run.load(boxes).plan()
    changed = {
        n
        for s, n, _ in plan.by_shape
        if s == "normalize" and plan.by_shape[s, n, None].recipe != plain.by_shape[s, n, None].recipe
    }
    assert changed == {"box/b1"} and {n for s, n, _ in plan.by_shape if s == "orient"} == {"box/b1"}


@pytest.mark.parametrize("reference", UP_AXES)
def test_examples_are_set_on_each_other_by_their_keypoints(reference: UpAxis) -> None:
    rng = np.random.default_rng(1)
    places = rng.normal(size=(7, 3)) * (0.2, 0.5, 0.3)
    ups: list[UpAxis] = [reference, "z", "-x", "-y"]
    motions = [turned(float(angle)).T @ to_y_up(up) for angle, up in zip(rng.uniform(0, 360, 4), ups, strict=True)]
    stood = Stance(reference, True)
    examples = [
        ExampleShape(places @ m, np.arange(7), places @ m, stood if i == 0 else None, None)
        for i, m in enumerate(motions)
    ]
    found = standing(examples)
    assert found.axes == ups and found.by == "undersides"
    first, *others = (e.keypoints @ r.T for e, r in zip(examples, found.rotations, strict=True))
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-9)
