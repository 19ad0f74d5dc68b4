"""The report's tables: every figure there is has a column, and what a column lacks is explained."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from b23d.pipeline.run import Run
from b23d.stages.workbench.commands.keypoints import notes
from b23d.stages.workbench.commands.table_files import write_table
from b23d.stages.workbench.report import details, page
from b23d.stages.workbench.results.gathering import Gathering
from b23d.stages.workbench.results.keypoints import keypoint_table
from b23d.stages.workbench.results.scores import run_scores
from b23d.stages.workbench.results.untold import Known, untold
from tests.report_runs import mixed
from tests.small_runs import b23d, make_boxes


def test_the_score_table_has_every_pck_that_scores_have() -> None:
    run = mixed()
    table = run_scores(run)
    text = page.environment().get_template("scores.html").render(table=page.score_lines(table), run={})
    head, *lines = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line) for line in re.split(r"<tr", text)[1:]]
    own = dict(zip(head, lines[0], strict=True))
    first = next(iter(table.classes.values()))
    for label, curve in (
        ("PCK .10", first.pck), ("sym. PCK .10", first.symmetric_pck), ("either front", first.either_front_pck),
    ):  # fmt: skip
        assert float(own[label]) == pytest.approx(curve.mean[-1], abs=0.006), label
    assert all(len(line) == len(head) for line in lines), "a cell for every column"


def test_what_is_empty_is_explained_where_it_is_listed(tmp_path: Path) -> None:
    """Other methods tell no confidence, and one shot no class: the table, its notes and the report say so."""
    path = make_boxes(tmp_path, 3)
    few = ["stages.optimize.method=nearest", "shots.count=1"]
    words = [word for text in few for word in ("--set", text)]
    b23d("run", str(path), "--workers", "0", *words)
    found = keypoint_table(Run.load(path, few))
    assert found.table[["confidence", "of_class"]].isna().all().all()
    sure, of_class = notes(found, True)[:2]
    assert sure == "confidence is empty: the method nearest tells none; stages.optimize.method=posterior does"
    assert of_class.startswith("of_class is empty: 1 shot cannot tell")
    b23d("report", str(path), *words)
    html = (tmp_path / "boxes" / "report.html").read_text()
    assert f"{sure}." in html and f"{of_class}." in html


def test_nothing_is_explained_that_is_told(tmp_path: Path) -> None:
    run = mixed()
    assert untold(run, {"a": Known(True, True)}) == [] and untold(run, {}) == []
    assert [
        line.partition(" is empty")[0] for line in untold(run, {"a": Known(True, True), "b": Known(True, False)})
    ] == ["of_class of b"]


def test_the_class_stands_beside_every_confidence(tmp_path: Path) -> None:
    run = mixed()
    table = keypoint_table(run).table
    one = table[(table["class"] == "box") & (table["shape"] == table[table["class"] == "box"]["shape"].iloc[0])]
    write_table(one, tmp_path / "one.ply")
    header = (tmp_path / "one.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "confidence" in header and "of_class" in header
    gathering = Gathering(run)
    for entry in map(gathering.entry, run.shapes):
        for attempt in entry.attempts:
            own = attempt.prediction.class_confidence
            assert details._attempt(entry, attempt)["ofClass"] == (
                None if own is None else pytest.approx(own, abs=1e-3)
            )
