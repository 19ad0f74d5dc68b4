"""The report's tables: every figure there is has a column, and what a column lacks is explained."""

from __future__ import annotations

import re

import pytest

from b23d.stages.workbench.report import page
from b23d.stages.workbench.results.scores import run_scores
from tests.report_runs import mixed


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
