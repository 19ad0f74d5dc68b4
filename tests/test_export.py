"""Exports: what other programs read back is what the store holds."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
from PIL import Image
from rich.console import Console, RenderableType

from b23d.pipeline.inspection.artifact import export_artifact
from b23d.pipeline.inspection.artifact import thumbnail as show_thumbnail
from b23d.pipeline.run import Run
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views
from b23d.stages.render import RenderParams, render
from b23d.stages.workbench.pictures.exporting import contact_sheet, glb, ply, png
from b23d.stages.workbench.pictures.palette import id_color, rgb
from b23d.stages.workbench.pictures.thumbnails import SHAPE, TILE, thumbnail, token_colors
from b23d.stages.workbench.results.gathering import Gathering
from b23d.stages.workbench.results.scores import run_scores
from tests.made_tokens import token_views
from tests.report_runs import mixed


@pytest.fixture(scope="module")
def run() -> Run:
    return mixed()


def target(run: Run, category: str) -> str:
    """A shape of the class that some draw predicts."""
    gathered = Gathering(run)
    return next(s.name for s in run.shapes if s.category == category and gathered.entry(s).attempts)


def normalized(run: Run, shape: str) -> NormalizedShape:
    found = run.artifact(shape, "normalize")
    assert isinstance(found, NormalizedShape)
    return found


def raw(loaded: trimesh.PointCloud, name: str) -> np.ndarray:
    return np.asarray(loaded.metadata["_ply_raw"]["vertex"]["data"][name]).reshape(-1)


def test_a_mesh_keeps_its_vertices_and_faces(run: Run, tmp_path: Path) -> None:
    shape = normalized(run, "box/b0")
    for suffix in (".ply", ".glb"):
        export_artifact(run, "box/b0", "normalize", None, tmp_path / f"b{suffix}")
        loaded = trimesh.load(tmp_path / f"b{suffix}", process=False, force="mesh")
        np.testing.assert_allclose(loaded.vertices, shape.vertices, atol=1e-7)
        np.testing.assert_array_equal(loaded.faces, shape.faces)


def test_a_texture_goes_into_glb_and_its_colours_into_ply(run: Run, tmp_path: Path) -> None:
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[0, 0], texture[1, 1] = (255, 0, 0), (0, 0, 255)  # upper left, lower right
    uvs = np.array([[[0.2, 0.8], [0.2, 0.8], [0.8, 0.2]]], np.float32)  # origin at the lower left
    shape = NormalizedShape(
        kind="mesh",
        vertices=np.eye(3, dtype=np.float32),
        faces=np.array([[0, 1, 2]], np.int32),
        face_uvs=uvs,
        texture=texture,
        points=np.eye(3, dtype=np.float32),
        point_faces=np.zeros(3, np.int32),
        point_barycentrics=np.eye(3, dtype=np.float32),
        candidates="fps",
        center=(0, 0, 0),
        scale=1,
        repairs={},
    )
    ply(run, "box/b0", "normalize", None, shape, tmp_path / "t.ply", "unit")
    colors = trimesh.load(tmp_path / "t.ply", process=False).visual.vertex_colors[:, :3]
    assert colors.tolist() == [[255, 0, 0], [255, 0, 0], [0, 0, 255]]
    glb(run, "box/b0", "normalize", None, shape, tmp_path / "t.glb", "unit")
    loaded = trimesh.load(tmp_path / "t.glb", process=False, force="mesh")
    np.testing.assert_allclose(loaded.visual.uv, uvs[0], atol=1e-6)
    np.testing.assert_array_equal(np.asarray(loaded.visual.material.baseColorTexture.convert("RGB")), texture)


def test_features_are_coloured_points_with_their_counts(run: Run, tmp_path: Path) -> None:
    features = run.artifact("egg/e0", "reweight")
    assert isinstance(features, PointFeatures)
    export_artifact(run, "egg/e0", "reweight", None, tmp_path / "f.ply")
    loaded = trimesh.load(tmp_path / "f.ply")
    assert isinstance(loaded, trimesh.PointCloud)
    np.testing.assert_allclose(loaded.vertices, normalized(run, "egg/e0").points, atol=1e-7)
    np.testing.assert_array_equal(raw(loaded, "count"), features.counts)
    np.testing.assert_array_equal(raw(loaded, "quality"), features.counts)
    np.testing.assert_array_equal(raw(loaded, "observed").astype(bool), features.observed)
    assert len(np.unique(loaded.colors[:, :3], axis=0)) > 50
    export_artifact(run, "egg/e0", "backproject", None, tmp_path / "f.glb")
    scene = trimesh.load(tmp_path / "f.glb")
    assert [len(g.vertices) for g in scene.geometry.values()] == [642]


def test_distances_are_a_field_from_the_first_candidate(run: Run, tmp_path: Path) -> None:
    distances = run.artifact("box/b0", "geodesic")
    assert isinstance(distances, GeodesicDistances)
    export_artifact(run, "box/b0", "geodesic", None, tmp_path / "d.ply")
    loaded = trimesh.load(tmp_path / "d.ply")
    np.testing.assert_array_equal(raw(loaded, "distance"), distances.distances[0].astype(np.float32))
    assert loaded.colors[0, :3].tolist() == [13, 8, 135], "no distance is the map's dark end"


@pytest.mark.parametrize("category", ["box", "egg"])
def test_keypoints_are_named_spheres_where_they_were_predicted(run: Run, tmp_path: Path, category: str) -> None:
    name = target(run, category)
    prediction = run.artifact(name, "optimize")
    assert isinstance(prediction, Prediction)
    export_artifact(run, name, "optimize", None, tmp_path / "p.glb")
    scene = trimesh.load(tmp_path / "p.glb")
    for number, at, present in zip(prediction.ids, prediction.positions, prediction.present, strict=True):
        ball = scene.geometry.get(f"predicted {number}")
        assert (ball is not None) == present
        if ball is not None:
            np.testing.assert_allclose(ball.vertices.mean(axis=0), at, atol=1e-5)
            assert ball.visual.vertex_colors[0, :3].tolist() == list(rgb(id_color(int(number))))
    assert sum(key.startswith("annotated") for key in scene.geometry) == (8 if category == "box" else 6)
    export_artifact(run, name, "optimize", None, tmp_path / "p.ply")
    whole = trimesh.load(tmp_path / "p.ply", process=False)
    assert len(whole.faces) == sum(len(part.faces) for part in scene.geometry.values()), (
        "the shape and all spheres in one"
    )


def test_pictures_and_contact_sheets(run: Run, tmp_path: Path) -> None:
    name = target(run, "box")
    for stage in ("normalize", "reweight", "geodesic", "optimize"):
        export_artifact(run, name, stage, None, tmp_path / f"{stage}.png")
        assert Image.open(tmp_path / f"{stage}.png").size == (800, 800)
    images = np.zeros((9, 64, 64, 3), np.uint8) + np.arange(9, dtype=np.uint8)[:, None, None, None]
    sheet = contact_sheet(images)
    assert sheet.shape == (128, 512, 3) and sheet[0, 70, 0] == 1 and sheet[70, 0, 0] == 8 and sheet[100, 100, 0] == 255
    views = Views(
        images=images,
        depth=np.zeros((9, 64, 64), np.float32),
        face_ids=np.zeros((9, 64, 64), np.int32),
        world_to_camera=np.zeros((9, 4, 4)),
        intrinsics=np.eye(3),
        renderer="none",
        distance=1,
    )
    png(run, name, "render", None, views, tmp_path / "views.png", "unit")
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "views.png")), sheet)


def test_predictions_of_the_whole_run_as_a_table(run: Run, tmp_path: Path) -> None:
    export_artifact(run, target(run, "egg"), "optimize", None, tmp_path / "p.parquet")
    table = pd.read_parquet(tmp_path / "p.parquet")
    collected = {(s.category, s.id, draw): a for s, draw, a in run.collect("optimize")}
    assert len(collected) == 6 and set(table.groupby(["class", "shape", "draw"]).groups) == set(collected)
    for key, rows in table[table["predicted"]].groupby(["class", "shape", "draw"]):
        prediction = collected[key]
        assert isinstance(prediction, Prediction)
        assert rows["id"].tolist() == prediction.ids.tolist()
        np.testing.assert_allclose(rows[["x", "y", "z"]], prediction.positions, atol=1e-6)
        shape = normalized(run, f"{key[0]}/{key[1]}")
        np.testing.assert_allclose(
            rows[["file_x", "file_y", "file_z"]], prediction.positions * shape.scale + shape.center, atol=1e-5
        )


def test_scores_of_the_whole_run_sum_to_the_score_table(run: Run, tmp_path: Path) -> None:
    export_artifact(run, target(run, "egg"), "score", None, tmp_path / "s.parquet")
    table = pd.read_parquet(tmp_path / "s.parquet")
    scores = run_scores(run)
    for name, of_class in scores.classes.items():
        sums = (
            table[table["class"] == name]
            .groupby(["draw", "threshold"])[["true_positives", "false_positives", "false_negatives"]]
            .sum()
        )
        iou = (sums["true_positives"] / sums.sum(axis=1)).groupby("threshold").mean()
        np.testing.assert_allclose(iou, of_class.iou.mean)


def test_what_has_no_such_form_says_what_to_do(run: Run, tmp_path: Path) -> None:
    name = target(run, "box")
    score = run.artifact(name, "score")
    assert isinstance(score, ShapeScore)
    for suffix in ("ply", "glb", "png"):
        with pytest.raises(
            ValueError, match=f".{suffix} export: expected .*, got ShapeScore from score; write it as .npz"
        ):
            export_artifact(run, name, "score", None, tmp_path / f"x.{suffix}")
    with pytest.raises(ValueError, match="a prediction or a score"):
        export_artifact(run, name, "normalize", None, tmp_path / "x.parquet")


@pytest.mark.parametrize("stage", ["normalize", "reweight", "geodesic", "optimize"])
def test_a_terminal_shows_thumbnails(run: Run, stage: str) -> None:
    assert_fits(show_thumbnail(run, target(run, "box"), stage, None, 90), lines=SHAPE // 2)


def test_views_are_shown_with_their_depth(run: Run) -> None:
    views = render(normalized(run, "box/b0"), RenderParams(rings={"count": 1}, resolution=32))
    assert_fits(thumbnail(run, "box/b0", views, 90), lines=TILE)


def assert_fits(shown: RenderableType | None, lines: int) -> None:
    """Half blocks in true colour, within 90 characters, two rows of pixels a line."""
    assert shown is not None
    console = Console(width=90, force_terminal=True, color_system="truecolor", file=io.StringIO(), record=True)
    console.print(shown)
    text, styled = console.export_text(clear=False), console.export_text(styles=True)
    assert "▄" in text and "38;2;" in styled
    assert len(text.rstrip("\n").splitlines()) == lines and max(map(len, text.splitlines())) <= 90


def test_a_score_has_no_thumbnail(run: Run) -> None:
    assert show_thumbnail(run, target(run, "box"), "score", None, 90) is None


def test_tokens_are_painted_alike_where_they_are_alike() -> None:
    tokens = np.zeros((2, 4, 4, 8), np.float16)
    tokens[:, :2, :, 0], tokens[:, 2:, :2, 1] = 1, 1
    views = token_views(tokens)
    colors = token_colors(views)
    np.testing.assert_array_equal(colors[0], colors[1])
    assert len(np.unique(colors.reshape(-1, 3), axis=0)) == 3
    np.testing.assert_array_equal(token_colors(views, [1])[0], colors[1])
    views.kept[1, 0, 0] = False
    assert (token_colors(views)[1, 0, 0] == 255).all()
