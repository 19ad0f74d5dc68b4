"""`b23d keypoints`: where the table says a keypoint is, the file itself has it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh

from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.stages.workbench.commands.keypoints import notes
from b23d.stages.workbench.results.keypoints import COLUMNS, FoundKeypoints, keypoint_table
from tests.report_runs import mixed
from tests.small_runs import FAST, b23d

FAR = np.array([3000.0, -20.0, 700.0])
"""The files' frame is far from the unit frame, and 40 times as large."""


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Boxes far from the origin; each file begins with two degenerate faces and a vertex that no face uses."""
    folder = tmp_path_factory.mktemp("boxes")
    (folder / "shapes" / "box").mkdir(parents=True)
    entries = []
    for i in range(4):
        box = trimesh.creation.box(extents=(40, 20 + 4 * i, 32)).subdivide()
        vertices = np.vstack([[[1e6, 0, 0]], box.vertices + FAR])
        faces = np.vstack([[[1, 1, 2], [3, 4, 4]], box.faces + 1])
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        lines += ["f {} {} {}".format(*face) for face in faces + 1]
        (folder / "shapes" / "box" / f"b{i}.obj").write_text("\n".join(lines))
        corners = trimesh.creation.box(extents=(40, 20 + 4 * i, 32)).vertices + FAR
        marks = [{"xyz": at.tolist(), "semantic_id": k} for k, at in enumerate(corners)]
        entries.append({"model_id": f"b{i}", "keypoints": marks})
    (folder / "shapes" / "keypoints.json").write_text(json.dumps(entries[:2]))
    path = folder / "boxes.toml"
    path.write_text(
        f'name = "boxes"\n[dataset]\nkind = "folder"\nroot = "shapes"\n[shots]\ncount = 2\ndraws = [0, 1]\n'
        f'[store]\nroot = "{folder / "store"}"\n' + FAST
    )
    output = b23d("run", str(path), "--workers", "0")
    assert f"b23d keypoints {path}" in output and f"b23d report {path}" in output
    return path


def file_of(run: Path, shape: str) -> tuple[np.ndarray, np.ndarray]:
    """(v, 3) and (f, 3), as the lines of the OBJ count them."""
    lines = [line.split() for line in (run.parent / "shapes" / "box" / f"{shape}.obj").read_text().splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], float)
    return vertices, np.array([line[1:] for line in lines if line[0] == "f"], int) - 1


def test_where_no_keypoints_were_asked_for_none_are_promised(boxes: Path) -> None:
    for asked in (("--set", 'outputs=["geodesic"]'), ("--until", "geodesic"), ("--stage", "geodesic")):
        output = b23d("run", str(boxes), "--workers", "0", "--force", *asked)
        assert "b23d keypoints" not in output and f"b23d list {boxes}" in output and f"b23d report {boxes}" in output
    assert "b23d keypoints" in b23d("run", str(boxes), "--workers", "0", "--force", "--until", "optimize")


def test_coordinates_vertices_and_faces_are_the_file_s_own(boxes: Path, tmp_path: Path) -> None:
    b23d("keypoints", str(boxes), "-o", str(tmp_path / "deep" / "k.csv"))
    table = pd.read_csv(tmp_path / "deep" / "k.csv")
    assert set(table["shape"]) == {"b2", "b3"} and len(table) == 16
    for row in table.itertuples():
        vertices, faces = file_of(boxes, row.shape)
        at = np.array([row.x, row.y, row.z])
        on_face = np.array([row.b0, row.b1, row.b2]) @ vertices[faces[row.face]]
        np.testing.assert_allclose(on_face, at, atol=1e-3)
        used = np.unique(faces[2:])
        assert row.vertex == used[np.linalg.norm(vertices[used] - at, axis=1).argmin()]


def test_every_format_holds_the_same(boxes: Path, tmp_path: Path) -> None:
    for suffix in ("csv", "json", "parquet"):
        b23d("keypoints", str(boxes), "-o", str(tmp_path / f"k.{suffix}"))
    csv, parquet = pd.read_csv(tmp_path / "k.csv"), pd.read_parquet(tmp_path / "k.parquet")
    rows = json.loads((tmp_path / "k.json").read_text())
    assert [row["id"] for row in rows] == csv["id"].tolist() == parquet["id"].tolist()
    np.testing.assert_allclose([row["x"] for row in rows], csv["x"])
    np.testing.assert_allclose(parquet["x"], csv["x"])
    b23d("keypoints", str(boxes), "--shape", "b3", "-o", str(tmp_path / "k.ply"))
    cloud = trimesh.load(tmp_path / "k.ply")
    np.testing.assert_allclose(cloud.vertices, csv[csv["shape"] == "b3"][["x", "y", "z"]])


def test_what_cannot_be_written_is_said_before_anything_is_read(boxes: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected a file of \.csv, \.json, \.parquet, \.ply, got '\.xls'"):
        b23d("keypoints", str(boxes), "-o", str(tmp_path / "k.xls"))
    with pytest.raises(ValueError, match="expected one shape for a PLY, got 2"):
        b23d("keypoints", str(boxes), "-o", str(tmp_path / "k.ply"))
    with pytest.raises(ValueError, match="expected a name or glob of the data set, got 'zebra'"):
        b23d("keypoints", str(boxes), "--shape", "zebra")


def test_equal_draws_are_said_and_not_repeated(boxes: Path) -> None:
    """Two annotated shapes and two shots: every draw is the same."""
    output = b23d("keypoints", str(boxes), "--all-draws")
    assert "draw 1 left out: the same shots" in output
    found = keypoint_table(Run.load(boxes), draws=[0, 1])
    assert found.alike == {"box": [1]} and "draw" not in found.table


def test_one_draw_unless_asked() -> None:
    run = mixed()
    one = keypoint_table(run, Selection(classes=("box",)))
    assert not one.table[["shape", "id"]].duplicated().any()
    several = keypoint_table(run, Selection(classes=("box",)), draws=[0, 1])
    assert set(several.table["draw"]) == {0, 1} and len(several.table) > len(one.table)
    shots = {d.seed: {s.id for s in d.shots} for d in run.plan().draws if d.category == "box"}
    for seed, names in shots.items():
        assert not names & set(several.table[several.table["draw"] == seed]["shape"]), "shots are not predicted"


def test_clouds_have_points_and_no_faces() -> None:
    table = keypoint_table(mixed(), Selection(classes=("egg",))).table
    assert len(table) and table["face"].isna().all() and table["b0"].isna().all()
    run = mixed()
    for row in table.itertuples():
        file = run.config.path.parent / "shapes" / "egg" / f"{row.shape}.xyz"
        np.testing.assert_allclose(np.loadtxt(file)[row.vertex], [row.x, row.y, row.z], atol=1e-6)


def test_a_surface_that_is_not_the_file_s_has_no_indices(boxes: Path) -> None:
    for path in (boxes.parent / "shapes" / "box").glob("*.obj"):  # a face less: closed ones stay as they are
        path.write_text("\n".join(path.read_text().splitlines()[:-1]))
    run = Run.load(boxes, ["stages.normalize.watertight=true", "stages.normalize.watertight_resolution=16"])
    run.execute(workers=0)
    table = keypoint_table(run).table
    assert len(table) == 16 and table[["vertex", "face", "b0"]].isna().all().all() and table["x"].notna().all()


def test_shapes_unlike_their_class_are_named() -> None:
    """By the mean over draws; where nothing is told, nobody is."""
    sure = {
        ("chairs", "a", 0): 0.9,
        ("chairs", "car", 0): 0.1,
        ("chairs", "car", 1): 0.6,
        ("chairs", "untold", 0): None,
    }
    rows = [{"class": c, "shape": s, "draw": d, "of_class": p} for (c, s, d), p in sure.items() for _ in range(3)]
    table = pd.DataFrame(rows).astype({"of_class": COLUMNS["of_class"]})
    found = FoundKeypoints(table, {}, {}, {}, 0)
    assert found.strangers() == ["chairs/car"]
    assert [line.rpartition(": ")[2] for line in notes(found, True)] == ["chairs/car"]
