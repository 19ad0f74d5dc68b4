"""The report's parts: colours, pictures, figures, and the page that is written."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.run import Run
from b23d.schemas.shape import NormalizedShape
from b23d.stages.scoring.quoted import B2_3D
from b23d.stages.workbench.pictures.figures import plot_shape, score_curves
from b23d.stages.workbench.pictures.packing import as_json
from b23d.stages.workbench.pictures.painting import marks, picture
from b23d.stages.workbench.pictures.principal import fit_basis
from b23d.stages.workbench.pictures.surface import EDGE, surface_of
from b23d.stages.workbench.report import page
from b23d.stages.workbench.report.choosing import best_and_worst, detailed, file_keys
from b23d.stages.workbench.report.details import details
from b23d.stages.workbench.report.page import duration
from b23d.stages.workbench.report.writing import write_report
from b23d.stages.workbench.results.columns import COLUMNS, Shown, confidence_of, shown_columns
from b23d.stages.workbench.results.gathering import Gathering
from b23d.stages.workbench.results.matching import keypoint_errors
from b23d.stages.workbench.results.rows import row
from b23d.stages.workbench.results.scores import run_scores
from b23d.stages.workbench.results.summary import settings
from b23d.stages.workbench.results.trust import judged
from tests.report_runs import mixed

plug_in()

RIDGE = "stages.learn.ridge=0.5"


@pytest.fixture(scope="module")
def run() -> Run:
    return mixed()


def mesh_shape(mesh: trimesh.Trimesh) -> NormalizedShape:
    vertices, faces = np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)
    count = min(len(vertices), 200)
    return NormalizedShape(
        kind="mesh",
        vertices=vertices,
        faces=faces,
        points=vertices[:count],
        point_faces=np.zeros(count, np.int32),
        point_barycentrics=np.zeros((count, 3), np.float32),
        candidates="fps",
        center=(0, 0, 0),
        scale=1,
        repairs={},
    )


def test_one_basis_gives_equal_features_equal_colours_on_every_shape() -> None:
    rng = np.random.default_rng(0)
    planted = rng.normal(size=(3, 40))
    shapes = [rng.normal(size=(600, 3)) * [5, 2, 1] @ planted + 7 for _ in range(3)]
    basis = fit_basis(shapes)
    np.testing.assert_allclose(basis.components @ basis.components.T, np.eye(len(basis.components)), atol=1e-9)
    assert basis.kept == pytest.approx(1) and len(basis.components) == 32
    projected = basis.project(shapes[0])
    np.testing.assert_allclose(projected @ basis.components + basis.mean, shapes[0], atol=1e-3)
    same = basis.colors(basis.project(np.stack([shapes[0][5], shapes[0][5]])))
    assert (same[0] == same[1]).all() and (same[0] == basis.colors(projected)[5]).all()
    with pytest.raises(ValueError, match="equal channels"):
        fit_basis([np.ones((4, 3)), np.ones((4, 5))])


def test_few_points_and_few_channels_still_have_a_basis() -> None:
    basis = fit_basis([np.array([[1.0, 2.0]])])
    assert basis.colors(basis.project(np.array([[1.0, 2.0]]))).shape == (1, 3)


def test_large_faces_are_divided_and_many_faces_merged() -> None:
    divided = surface_of(mesh_shape(trimesh.creation.box(extents=(1, 0.3, 0.3))), limit=20_000)
    assert divided is not None and not divided.coarse
    corners = divided.vertices[divided.faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= EDGE
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(2 * (0.3 + 0.3 + 0.09), rel=1e-5)
    coarse = surface_of(mesh_shape(trimesh.creation.icosphere(subdivisions=5, radius=0.5)), limit=3000)
    assert coarse is not None and coarse.coarse and 500 < len(coarse.faces) <= 3000
    assert np.linalg.norm(coarse.vertices, axis=1) == pytest.approx(0.5, abs=0.05)
    assert coarse.faces.max() == len(coarse.vertices) - 1


def test_pictures_show_the_shape_and_nothing_around_it(run: Run) -> None:
    gathered = Gathering(run)
    for shape in (run.shapes[0], next(s for s in run.shapes if s.category == "egg")):
        entry = gathered.entry(shape)
        assert entry.normalized is not None
        plain = picture(entry.normalized, None, 96)
        assert plain.shape == (96, 96, 4) and plain[0, 0, 3] == 0 and plain[48, 48, 3] == 255
        filled = (plain[..., 3] > 128).mean()
        assert 0.1 < filled < 0.9
        attempt = entry.attempt()
        if attempt is not None:
            marked = picture(entry.normalized, None, 96, marks(entry, attempt.prediction))
            assert (marked != plain).any()


def test_rows_agree_with_scores(run: Run) -> None:
    gathered = Gathering(run)
    compared = 0
    for shape in run.shapes:
        entry = gathered.entry(shape)
        for attempt in entry.attempts:
            assert attempt.score is not None
            errors = np.array(list(keypoint_errors(entry, attempt).values()))
            assert [int((errors <= at).sum()) for at in attempt.score.thresholds] == attempt.score.labelled.tolist()
            compared += 1
        line = row(entry)
        assert json.dumps(line, allow_nan=False)
        made = "unpredicted" if gathered.plan.no_shots(shape.category) else "done"
        assert line["state"] == ("failed" if shape.name == "box/broken" else made)
    assert compared == 2 * (2 + 1), "two draws of two shots of four boxes and three eggs"


def test_details_are_whole_and_small(run: Run) -> None:
    gathered = Gathering(run)
    entry = gathered.entry(run.shapes[0])
    assert entry.features is not None
    text = as_json(details(entry, fit_basis([entry.features.features])))
    assert len(text) < 150_000
    value = json.loads(text)
    assert value["points"]["steps"]["shape"] == [256, 3] and value["surface"] and value["distances"]["largest"] > 0.5
    assert len(value["truth"]) == 8 and value["kind"] == "mesh"


def test_settings_tell_what_differs(run: Run) -> None:
    lines = {line["key"]: line for line in settings(run)}
    assert lines["stages.learn.ridge"]["differs"] and lines["stages.learn.ridge"]["value"] == "0.5"
    assert lines["stages.learn.ridge"]["means"], "fields say what they mean"
    assert "stages.optimize.discrete.starts" not in lines, "only what counts is listed"
    assert not lines["stages.optimize.posterior.temper"]["differs"]


def test_views_are_kept_for_extremes_and_shots_first() -> None:
    rows = [{"points": 9, "category": "c", "auc": i / 100, "shot": [0] if i == 50 else []} for i in range(100)]
    assert detailed(rows, 1000) == set(range(100))
    chosen = detailed(rows, 20)
    assert len(chosen) == 20 and {0, 1, 2, 97, 98, 99, 50} <= chosen
    assert best_and_worst(rows) == [(99, "best"), (0, "worst")]
    assert best_and_worst(rows[:1]) == [(0, "best")]


def test_files_have_plain_and_different_names(run: Run) -> None:
    from dataclasses import replace

    shape = run.shapes[0]
    keys = file_keys([replace(shape, id=name) for name in ("a b", "a/b", "A B", "é", "x")])
    assert len({key.lower() for key in keys}) == 5 and all(re.fullmatch(r"[A-Za-z0-9._-]+", key) for key in keys)


def test_text_cannot_leave_its_script_element() -> None:
    text = as_json({"name": "</script><script>alert(1)</script>"})
    assert "<" not in text and json.loads(text)["name"].startswith("</script>")
    with pytest.raises(ValueError, match="JSON"):
        as_json({"x": float("nan")})


def test_curves_hold_the_scores_and_the_papers_figures(run: Run) -> None:
    table = run_scores(run)
    figure = score_curves(table)
    named = {trace.name: trace for trace in figure.data if trace.mode != "lines" or trace.showlegend is not False}
    assert list(named["box"].y) == table.classes["box"].iou.mean
    assert tuple(named["B2-3D (paper)"].y) == B2_3D.iou and B2_3D.auc == pytest.approx(0.507, abs=1e-3)
    assert not any("FSKD" in name for name in named), "it has no printed figures"


def test_a_shape_plots_in_one_line(run: Run) -> None:
    gathered = Gathering(run)
    name = next(s.name for s in run.shapes if s.category == "box" and gathered.entry(s).attempts)
    figure = plot_shape(run, name)
    assert {"shape", "annotated"} <= {trace.name for trace in figure.data} and any(
        "predicted" in (t.name or "") for t in figure.data
    )
    assert figure.to_json()
    with pytest.raises(KeyError, match="did you mean 'box/b0'"):
        plot_shape(run, "b0")


def test_the_command_writes_a_page_and_says_where(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    result = CliRunner().invoke(
        app,
        ["report", str(run.config.path), "--set", "stages.learn.ridge=0.5", "--out", str(out), "--beside"],
    )
    assert result.exit_code == 0, result.output
    assert "3D views of 8 of 9 shapes" in result.output and "page-details" in result.output
    text = out.read_text()
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=[\"']?(https?:)?//", text), "nothing from the network"
    assert "box/broken" in text and "class lonely" in text
    assert len(list((tmp_path / "page-details").glob("*.js"))) == 8
    again = CliRunner().invoke(
        app,
        ["report", str(run.config.path), "--set", "stages.learn.ridge=0.5", "--out", str(out), "--inline"],
    )
    assert again.exit_code == 0 and sorted(path.name for path in tmp_path.iterdir()) == ["page.html"], (
        "no stale details beside it"
    )


def test_a_damaged_artifact_costs_its_own_shape_only(run: Run, tmp_path: Path) -> None:
    shutil.copytree(run.config.path.parent, tmp_path / "copy")
    overrides = ["stages.learn.ridge=0.5"]
    copy = Run.load(tmp_path / "copy" / "mixed.toml", overrides, store=str(tmp_path / "copy" / "store"))
    node = copy.node("box/b1", "geodesic")
    chunk = next(Path(copy.store.path("geodesic", node.address)).glob("distances/c/*/*"))
    data = bytearray(chunk.read_bytes())
    data[len(data) // 2] ^= 1
    chunk.write_bytes(bytes(data))
    made = write_report(copy, inline=True)
    assert made.detailed == 7
    rows = json.loads(re.search(r'id="data">(.*?)</script>', made.page.read_text(), re.S)[1])["rows"]  # type: ignore[index]
    failed = {line["name"]: line["errors"] for line in rows if line["state"] == "failed"}
    assert set(failed) == {"box/b1", "box/broken"} and "b23d verify" in failed["box/b1"][0]


def test_a_run_that_made_nothing_has_no_report(run: Run, tmp_path: Path) -> None:
    empty = Run.load(run.config.path, store=str(tmp_path / "empty"))
    with pytest.raises(ValueError, match="run it first"):
        write_report(empty, tmp_path / "page.html")


def test_durations_read_like_durations() -> None:
    assert [duration(s) for s in (0.4, 59.4, 200, 14_700)] == ["0 s", "59 s", "3 min 20 s", "4 h 5 min"]


def test_columns_without_a_value_go_away() -> None:
    """As the score columns do where nothing is annotated; a value of 0 is one."""
    row = dict.fromkeys(column.key for column in COLUMNS) | {"name": "a", "draws": [], "unseen": 0.0}
    assert [column.key for column in shown_columns([row, row])] == ["name", "unseen"]
    scored = shown_columns([row, row | {"auc": 0.5, "confidence": 0.25}])
    assert [column.key for column in scored] == ["name", "auc", "confidence", "unseen"]


def test_the_page_can_show_every_kind_of_column() -> None:
    script = (Path(page.__file__).parent / "static" / "table.js").read_text()
    cells = script[script.index("const CELLS") : script.index("};", script.index("const CELLS"))]
    assert set(re.findall(r"(\w+): ", cells)) == set(get_args(Shown))


def test_confidence_is_of_the_keypoints_judged_present(run: Run) -> None:
    entry = Gathering(run).entry(run.shapes[0])
    attempt = next(attempt for attempt in entry.attempts)
    count = len(attempt.prediction.ids)
    sure, present = np.linspace(0, 1, count, dtype=np.float32), np.arange(count) % 2 == 0

    def told(**fields: object) -> float | None:
        return confidence_of(replace(attempt, prediction=attempt.prediction.model_copy(update=fields)))

    assert told(confidence=sure, present=present) == pytest.approx(sure[present].mean())
    assert told(confidence=None) is None and told(confidence=sure, present=~present & present) is None


def test_what_was_right_is_judged_as_scored_and_shown_over_what_was_said(run: Run) -> None:
    """The reliability diagram speaks of every keypoint judged present on an annotated target, absent ones as wrong."""
    gathering = Gathering(run)
    pairs = []
    for entry in map(gathering.entry, run.shapes):
        found = judged(entry)
        present = sum(int(attempt.prediction.present.sum()) for attempt in entry.attempts)
        assert len(found) == (present if entry.keypoints is not None and len(entry.keypoints.ids) else 0)
        pairs += found
        for attempt in entry.attempts:
            exact = attempt.prediction.model_copy(update={"present": np.zeros_like(attempt.prediction.present)})
            nothing = replace(attempt, prediction=exact)
            assert judged(replace(entry, attempts=[nothing])) == []
    lines = page.reliability_lines(pairs)
    assert lines is not None and lines["count"] == str(len(pairs))
    assert sum(int(line["count"]) for line in lines["bins"]) == len(pairs)
    assert page.reliability_lines([]) is None


def test_shapes_unlike_their_class_are_counted_on_the_page(run: Run) -> None:
    rows = [
        {**row(Gathering(run).entry(shape)), "of_class": sure}
        for shape, sure in zip(run.shapes, (0.2, 0.9), strict=False)
    ]
    told = {card["label"]: card["value"] for card in page.cards(rows, None, [])}
    assert told["unlike their class"] == "1 shape"
    rows[0]["of_class"] = None
    assert "unlike their class" not in {card["label"] for card in page.cards(rows, None, [])}
