"""What "does annotating more help?" makes of scores that are known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.analyses.interface import Chart, ExecutedMember
from b23d.stages.workbench.analyses.shots import Parameters, analyse

PARAMS = Parameters(kind="shots")


def score(right: int, of: int = 10) -> ShapeScore:
    """`right` keypoints of `of` are predicted, exactly, and nothing else."""
    at = np.array([right, right], np.int32)
    none, missed = np.zeros(2, np.int32), np.array([of - right] * 2, np.int32)
    return ShapeScore(
        thresholds=np.array([0.0, 0.1]), true_positives=at, false_positives=none, false_negatives=missed, matched=at,
        labelled=at, symmetric=at, either_front=at, annotated=of, predicted=right, common=right,
        ceiling=np.array([of, of], np.int32),
        distances=np.zeros((right, of), np.float32), protocol="", annotation_file="",
    )  # fmt: skip


def member(count: int, found: dict[tuple[str, int], int]) -> ExecutedMember:
    """A run with so many shots. found: target's name and draw → how many of its ten keypoints."""
    config = SimpleNamespace(file=SimpleNamespace(name="made up", shots=SimpleNamespace(count=count)))
    part = ExecutedMember(f"shots.count = {count}", "shots.count", cast(Any, SimpleNamespace(config=config)))
    part.__dict__["entries"] = {
        name: SimpleNamespace(
            shape=SimpleNamespace(category=name.split("/")[0]),
            attempts=[SimpleNamespace(draw=d, score=score(right)) for (n, d), right in found.items() if n == name],
        )
        for name in sorted({name for name, _ in found})
    }
    return part


FEW = member(1, {("cup/a", 0): 2, ("cup/b", 0): 4, ("cup/a", 1): 3, ("cup/c", 1): 9, ("jar/a", 0): 5, ("jar/a", 1): 5})
MORE = member(3, {("cup/a", 0): 5, ("cup/a", 1): 4, ("jar/a", 0): 6, ("jar/a", 1): 4})


def test_all_counts_are_judged_on_the_targets_that_are_left_in_each() -> None:
    found = analyse([MORE, FEW], PARAMS)
    rows = found.table.set_index(["class", "shots"])
    np.testing.assert_allclose(rows["AUC"]["cup"], [0.25, 0.45])  # b and c are shots once there are three
    np.testing.assert_allclose(rows["PCK"]["jar"], [0.5, 0.5])
    np.testing.assert_allclose(rows["AUC"]["mean"], [0.375, 0.475])
    assert rows["targets"].tolist() == [1, 1, 1, 1, 2, 2] and (rows["draws"] == 2).all()


def test_what_more_shots_bring_is_told_draw_by_draw() -> None:
    """The spread of the gain is not that of the scores."""
    rows = analyse([FEW, MORE], PARAMS).table.set_index(["class", "shots"])
    assert np.isnan(rows["AUC more"]["cup"][1]) and rows["AUC more"]["cup"][3] == pytest.approx(0.2)
    assert rows["AUC more sd"]["cup"][3] == pytest.approx(np.std([0.3, 0.1], ddof=1))
    assert rows["PCK more sd"]["jar"][3] == pytest.approx(np.std([0.1, -0.1], ddof=1))
    (block,) = analyse([FEW, MORE], PARAMS).blocks
    assert isinstance(block, Chart) and "From 1 to 3 annotated shapes of a class: +0.100" in block.caption
    assert {trace.name for trace in block.figure.data if trace.name} == {
        f"{category}, {figure}" for category in ("cup", "jar", "mean") for figure in ("AUC", "PCK")
    }


def test_counts_must_differ_and_leave_targets_in_common() -> None:
    for parts in ([FEW], [FEW, FEW]):
        with pytest.raises(ValueError, match=r"expected members of different shots\.count, got \[1"):
            analyse(parts, PARAMS)
    with pytest.raises(ValueError, match="no shot of any draw of up to 3 shots, got none"):
        analyse([FEW, member(3, {("cup/z", 0): 1})], PARAMS)


def test_one_draw_tells_no_spread() -> None:
    found = analyse([member(1, {("cup/a", 0): 2}), member(3, {("cup/a", 0): 5})], PARAMS)
    assert found.table[["AUC sd", "PCK sd", "AUC more sd", "PCK more sd"]].isna().all(axis=None)
    (block,) = found.blocks
    assert isinstance(block, Chart) and block.caption.endswith("+0.300 AUC and +0.300 PCK (cup).")
    assert not any(np.isnan(np.array(trace.y, float)).any() for trace in block.figure.data)


def test_a_class_without_targets_in_common_is_named() -> None:
    few, more = {("cup/a", 0): 2, ("jar/a", 0): 5}, {("cup/a", 0): 5}
    assert analyse([member(1, few), member(3, more)], PARAMS).note.endswith("every row: jar.")
    assert "Left out" not in analyse([FEW, MORE], PARAMS).note
