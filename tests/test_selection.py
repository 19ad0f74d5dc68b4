"""Selection: names, globs and files choose shapes, and nothing else about a run changes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import SelectionError
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from tests.small_runs import b23d, make_boxes

SHAPES = [Shape(f"{c}{i}", c, {}) for c in ("chair", "table") for i in range(3)] + [Shape("[red]x[/]", "odd", {})]
NAMES = {shape.name for shape in SHAPES}


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        (Selection(), NAMES),
        (Selection(shapes=("chair/chair1",)), {"chair/chair1"}),
        (Selection(shapes=("chair1",)), {"chair/chair1"}),
        (Selection(shapes=("chair/*",)), {"chair/chair0", "chair/chair1", "chair/chair2"}),
        (Selection(shapes=("*1", "table/table2")), {"chair/chair1", "table/table1", "table/table2"}),
        (Selection(classes=("t*",)), {"table/table0", "table/table1", "table/table2"}),
        (Selection(classes=("table",), limit=1), {"table/table0"}),
        (Selection(limit=1), {"chair/chair0", "table/table0", "odd/[red]x[/]"}),
        (Selection(shapes=("odd/[red]x[/]",)), {"odd/[red]x[/]"}),
        (Selection(only_failed=True), {"table/table1"}),
        (Selection(only_failed=True, classes=("chair",)), set()),
    ],
)
def test_all_that_is_said_must_hold(selection: Selection, expected: set[str]) -> None:
    assert selection.targets(SHAPES, failed={"table/table1"}) == expected


def test_a_file_lists_names_and_globs(tmp_path: Path) -> None:
    listed = tmp_path / "mine.txt"
    listed.write_text("# worth another look\nchair/chair2\n\n  table*0  \n")
    assert Selection(shapes=(f"@{listed}",)).targets(SHAPES) == {"chair/chair2", "table/table0"}


@pytest.mark.parametrize(
    ("selection", "message"),
    [
        (Selection(shapes=("chiar/chair1",)), "--shape: expected .* got 'chiar/chair1'; did you mean 'chair/chair1'"),
        (Selection(classes=("sofa",)), "--class: expected .* got 'sofa'"),
        (Selection(shapes=("@nowhere.txt",)), "--shape @nowhere.txt: expected a text file"),
    ],
)
def test_what_matches_nothing_is_an_error(selection: Selection, message: str) -> None:
    with pytest.raises(SelectionError, match=message):
        selection.targets(SHAPES)


def test_stages_are_checked() -> None:
    Selection(stages=("render",), until="extract").check_stages(["render", "extract"])
    with pytest.raises(SelectionError, match="did you mean 'extract'"):
        Selection(until="extrct").check_stages(["render", "extract"])


@pytest.mark.parametrize("annotated", [0, 1])
def test_shots_are_missed_by_what_needs_them_alone(tmp_path: Path, annotated: int) -> None:
    """Two shots are asked for, and none or one is there: what needs no shots goes through, and `run` ends with 0."""
    path = make_boxes(tmp_path, 3)
    file = tmp_path / "shapes" / "keypoints.json"
    file.write_text(json.dumps(json.loads(file.read_text())[:annotated]))
    run = Run.load(path)
    for stage in ("normalize", "reweight", "geodesic", *["annotation"] * annotated):
        for selection in (Selection(until=stage), Selection(stages=(stage,))):
            assert not run.plan(selection).problems, stage
    for selection in (
        Selection(),
        Selection(until="learn"),
        Selection(stages=("normalize", "score")),
        *[Selection(until="annotation")] * (not annotated),  # there is nothing to check
    ):
        (problem,) = run.plan(selection).problems
        assert "annotat" in problem.error
    assert run.plan(Selection(until="normalize")).draws == run.plan().draws, "draws are what they are"
    b23d("run", str(path), "--workers", "0", "--until", "normalize")
    assert "got" in b23d("run", str(path), "--workers", "0", "--until", "learn", code=1)
