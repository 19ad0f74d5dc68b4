"""`b23d init`: a folder of shapes becomes a run file that plans."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from b23d.pipeline.run import Run
from b23d.schemas.up_axis import UP_AXES, UpAxis, to_y_up
from b23d.stages.datasets.survey import survey
from b23d.stages.geometry.upright import Stance, guess, stance, support
from b23d.stages.workbench.results.run_file_text import run_name
from tests.made_datasets import PCD, PLY_MESH, entry, put
from tests.small_runs import b23d


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def planned(path: Path) -> Run:
    run = Run.load(path)
    run.plan()
    return run


def scored_in(run: Run) -> object:
    return run.config.params["score"].model_dump()["units"]


def test_a_flat_folder_gets_a_run_file_beside_it(here: Path) -> None:
    put(here, {f"my shapes/s{i}.ply": PLY_MESH for i in range(5)})
    output = b23d("init", "my shapes")
    assert "5 shapes of 1 class (ply), none annotated yet" in output
    assert "next: b23d annotate my-shapes.toml   #" in output
    run = planned(here / "my-shapes.toml")
    assert [shape.name for shape in run.shapes] == [f"my shapes/s{i}" for i in range(5)]
    assert run.config.file.shots.count == 3 and run.config.file.shots.draws == [0]
    assert scored_in(run) == "unit", "a folder's shapes may have any size"


def test_it_goes_into_runs_where_there_is_one_and_nothing_is_overwritten(here: Path) -> None:
    put(here, {"shapes/chair/a.ply": PLY_MESH, "shapes/table/b.ply": PLY_MESH, "runs/other.toml": "name = 1"})
    b23d("init", "shapes")
    path = here / "runs" / "shapes.toml"
    assert {shape.category for shape in planned(path).shapes} == {"chair", "table"}
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="--force replaces it"):
        b23d("init", "shapes")
    assert path.read_text() == "mine"
    b23d("init", "shapes", "--force")
    planned(path)


@pytest.mark.parametrize(("annotated", "count"), [(1, 1), (2, 2), (3, 3), (5, 3), (6, 3)])
def test_shots_are_as_many_as_are_annotated(here: Path, annotated: int, count: int) -> None:
    files: dict = {f"shapes/s{i}.ply": PLY_MESH for i in range(6)}
    put(here, {**files, "shapes/keypoints.json": [entry(f"s{i}", None) for i in range(annotated)]})
    assert "next: b23d run" in b23d("init", "shapes")
    run = planned(here / "shapes.toml")
    assert run.config.file.shots.count == count
    assert [draw.error for draw in run.plan().draws] == [None], "one draw, and it can be made"


def test_shapenet_s_and_keypointnet_s_layouts_are_known(here: Path) -> None:
    put(here, {f"net/chair/m{i}/models/model_normalized.ply": PLY_MESH for i in range(3)})
    b23d("init", "net")
    assert {shape.id for shape in planned(here / "net.toml").shapes} == {"m0", "m1", "m2"}
    put(
        here,
        {"kn/annotations/chair.json": [entry("m0"), entry("m1")], "kn/pcds/01/m0.pcd": PCD, "kn/pcds/01/m1.pcd": PCD},
    )
    output = b23d("init", "kn", "-o", "kn.toml")
    assert 'kind = "keypointnet"' in output and "next: b23d run" in output
    run = planned(here / "kn.toml")
    assert len(run.shapes) == 2 and scored_in(run) == "dataset", "as published"


def test_two_formats_of_every_shape_take_one(here: Path) -> None:
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    put(here, {f"both/s{i}.{suffix}": data for i in range(3) for suffix, data in (("ply", PLY_MESH), ("obj", obj))})
    b23d("init", "both")
    assert len(planned(here / "both.toml").shapes) == 3


def test_a_broken_shape_is_said_and_stops_nothing(here: Path) -> None:
    put(here, {"shapes/good.ply": PLY_MESH, "shapes/bad.obj": b"v 0 0\nf 1 2 3\n"})
    assert "set aside: " in b23d("init", "shapes")
    assert len(planned(here / "shapes.toml").shapes) == 2


def test_no_folder_and_no_shapes_are_errors_that_help(here: Path) -> None:
    with pytest.raises(FileNotFoundError, match="expected a folder, got none at nowhere"):
        b23d("init", "nowhere")
    (here / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="expected files like"):
        b23d("init", "empty")
    assert not (here / "empty.toml").exists()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_table_stands_on_any_axis(axis: int) -> None:
    top = trimesh.creation.box((1, 0.1, 0.8)).subdivide()
    legs = [
        trimesh.creation.box((0.1, 0.7, 0.1)).apply_translation((x, -0.4, z)) for x in (-0.4, 0.4) for z in (-0.3, 0.3)
    ]
    table = trimesh.util.concatenate([top, *legs])
    turned = np.roll(table.vertices, axis - 1, axis=1)
    found = support(turned, table.faces)
    assert found.argmax() == axis
    told = guess([stance(turned, table.faces)] * 3)
    assert told.axis == "xyz"[axis] and told.votes == 3


def test_a_ball_does_not_tell() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    assert guess([stance(ball.vertices, ball.faces)]).axis is None


@pytest.mark.parametrize("up", UP_AXES)
def test_a_cone_says_which_end_is_up(up: UpAxis) -> None:
    cone = trimesh.creation.cone(radius=0.5, height=1, sections=64)  # along +z
    upright = cone.vertices @ to_y_up("z").T
    found = stance(upright @ to_y_up(up), cone.faces)
    assert found == Stance(up, True) and guess([found] * 3).axis == up
    upright_seen = found.seen_in(to_y_up(up))
    assert upright_seen == Stance("y", True) and upright_seen.seen_in(to_y_up(up).T) == found


def test_a_class_that_stands_on_two_axes_is_mixed() -> None:
    y, z, down, either = Stance("y", True), Stance("z", False), Stance("-y", True), Stance("y", False)
    assert guess([y, y, y, z, z, None]).mixed == (("y", 3), ("z", 2))
    assert guess([z, y, y, z]).mixed == guess([y, z, z, y]).mixed == (("y", 2), ("z", 2)), "in any order"
    assert guess([y, y, y, down, down, down]).mixed == (("y", 3), ("-y", 3))
    assert guess([y, y, y, y, y, z]).axis == "y", "one is none"
    assert guess([either, either, either, down, down, None]).axis == "y", "tables on one leg"
    assert guess([down, down, down, down, None, either]).axis == "-y"
    assert guess([y, None, None, None]).axis is None and guess([]).axis is None


def test_z_up_shapes_are_pointed_out(here: Path) -> None:
    cone = trimesh.creation.cone(radius=0.5, height=1, sections=64)
    put(here, {f"cones/c{i}.stl": trimesh.exchange.stl.export_stl(cone) for i in range(3)})
    found = survey(here / "cones").classes[0]
    assert found.up is not None and found.up.axis == "z" and found.box == pytest.approx((1, 1, 1), rel=0.01)
    assert "up looks like z (3 of 3 stand on it)" in b23d("init", "cones")
    run = planned(here / "cones.toml")
    assert run.config.dataset.up == "z"
    assert run.config.dataset.listed()[0].leaves["source"].read().up == "z"  # type: ignore[attr-defined]


def cone(up: UpAxis, i: int) -> bytes:
    made = trimesh.creation.cone(radius=0.5 + 0.01 * i, height=1, sections=64)
    made.vertices = made.vertices @ to_y_up("z").T @ to_y_up(up)
    data: bytes = trimesh.exchange.stl.export_stl(made)
    return data


def test_classes_that_differ_get_a_table_and_a_mixed_one_is_told(here: Path) -> None:
    files = {f"all/{name}/{i}.stl": cone(up, i) for name, up in (("a", "z"), ("b", "-x"), ("c", "y")) for i in range(3)}
    put(here, {**files, **{f"all/d/{i}.stl": cone("y" if i % 2 else "z", i) for i in range(6)}})
    output = b23d("init", "all")
    assert "d: up looks mixed: of 6 shapes looked at, 3 on y and 3 on z stand" in " ".join(output.split())
    assert planned(here / "all.toml").config.dataset.up == {"a": "z", "b": "-x"}


def test_a_run_s_end_plan_and_report_tell_what_stands_otherwise(here: Path) -> None:
    put(here, {f"all/d/{i}.stl": cone("y" if i % 2 else "z", i) for i in range(6)})
    put(here, {f"all/e/{i}.stl": cone("z", 9 + i) for i in range(3)})
    path = here / "all.toml"
    store = here / "store"
    path.write_text(
        f'name = "all"\noutputs = ["normalize"]\n[dataset]\nkind = "folder"\nroot = "all"\n[store]\nroot = "{store}"\n'
    )
    mixed = "class d: up looks mixed: of 6 shapes looked at, 3 on y and 3 on z stand"
    tipped = "class e: 3 of 3 shapes looked at stand on z, and are taken to have y up"
    for verb in ("run", "plan"):
        output = " ".join(b23d(verb, str(path)).split())
        assert mixed in output and tipped in output, verb
    b23d("report", str(path))
    page = (here / "all" / "report.html").read_text()
    assert mixed in page and tipped in page
    said = 'dataset.up={e = "z", "d/[024]" = "z"}'
    output = b23d("run", str(path), "--set", said)
    assert "stand" not in output and "stand" not in b23d("plan", str(path), "--set", said)


@pytest.mark.parametrize(
    ("folder", "name"), [("my shapes", "my-shapes"), ("Stühle", "St-hle"), ("..", ""), ("_x", "x"), ("äö", "shapes")]
)
def test_a_folder_s_name_becomes_a_run_s(here: Path, folder: str, name: str) -> None:
    (here / folder).mkdir(exist_ok=True)
    made = run_name(here / folder)
    path = here / "r.toml"
    path.write_text(f'name = {json.dumps(made)}\n[dataset]\nkind = "procedural"\n')
    assert planned(path).name == made and name in ("", made)
