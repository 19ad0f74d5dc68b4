"""`b23d init`: a folder of shapes becomes a run file that plans."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from b23d.pipeline.run import Run
from b23d.stages.datasets.survey import survey
from b23d.stages.geometry.upright import guess, support
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


def test_a_flat_folder_gets_a_run_file_beside_it(here: Path) -> None:
    put(here, {f"my shapes/s{i}.ply": PLY_MESH for i in range(5)})
    output = b23d("init", "my shapes")
    assert "5 shapes of 1 class (ply), none annotated yet" in output
    assert "next: b23d annotate my-shapes.toml   #" in output
    run = planned(here / "my-shapes.toml")
    assert [shape.name for shape in run.shapes] == [f"my shapes/s{i}" for i in range(5)]
    assert run.config.file.shots.count == 3 and run.config.file.shots.draws == [0]


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
    assert len(planned(here / "kn.toml").shapes) == 2


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
    assert guess([found] * 3).axis == "xyz"[axis] and guess([found] * 3).votes == 3


def test_a_ball_does_not_tell() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    assert guess([support(ball.vertices, ball.faces)]).axis is None


def test_z_up_shapes_are_pointed_out(here: Path) -> None:
    cone = trimesh.creation.cone(radius=0.5, height=1, sections=64)
    put(here, {f"cones/c{i}.stl": trimesh.exchange.stl.export_stl(cone) for i in range(3)})
    found = survey(here / "cones").classes[0]
    assert found.up is not None and found.up.axis == "z" and found.box == pytest.approx((1, 1, 1), rel=0.01)
    assert "up looks like z (3 of 3 stand on it)" in b23d("init", "cones")


@pytest.mark.parametrize(
    ("folder", "name"), [("my shapes", "my-shapes"), ("Stühle", "St-hle"), ("..", ""), ("_x", "x"), ("äö", "shapes")]
)
def test_a_folder_s_name_becomes_a_run_s(here: Path, folder: str, name: str) -> None:
    (here / folder).mkdir(exist_ok=True)
    made = run_name(here / folder)
    path = here / "r.toml"
    path.write_text(f'name = {json.dumps(made)}\n[dataset]\nkind = "procedural"\n')
    assert planned(path).name == made and name in ("", made)
