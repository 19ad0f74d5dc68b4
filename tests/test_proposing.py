"""Which shape to annotate next: by what the run has stored, and in the order of names where it has stored nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from b23d.pipeline.cli import plug_in
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.stages.solvers.likeness import cosine, occupancy, overlap, standardised
from b23d.stages.workbench.annotate.looks import looks_of
from b23d.stages.workbench.annotate.proposing import proposed
from b23d.stages.workbench.annotate.walk import Walk
from tests.small_runs import make_boxes

plug_in()


def covered(alike: np.ndarray, chosen: list[int]) -> float:
    return float(alike[:, chosen].max(1).sum())


@given(st.integers(0, 10_000), st.integers(2, 12), st.integers(0, 3))
def test_each_proposal_covers_most(seed: int, n: int, done: int) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(size=(n, 2))
    alike = -np.linalg.norm(points[:, None] - points[None], axis=2)
    annotated = random.permutation(n)[: min(done, n - 1)].tolist()
    order = proposed(alike, annotated, range(n), ahead=n)
    assert sorted(order + annotated) == list(range(n)), "each once, and none that is annotated"
    chosen = list(annotated)
    for one in order:
        best = max(covered(alike, [*chosen, other]) for other in range(n) if other not in chosen)
        assert covered(alike, [*chosen, one]) == pytest.approx(best)
        chosen.append(one)


def test_groups_get_one_each_before_any_gets_two() -> None:
    places = np.array([0, 0.1, 0.2, 10, 10.1, 10.2, 10.3, 20, 20.1, 34.0])
    order = proposed(-np.abs(places[:, None] - places[None]), [], range(10), ahead=4)
    assert order[0] in (3, 4, 5, 6), "the middle of all"
    assert [{*range(3)}, {7, 8}, {9}] == sorted(
        ({*range(3)} if i < 3 else {7, 8} if i in (7, 8) else {9} for i in order[1:]), key=min
    )


def test_shapes_are_most_like_themselves() -> None:
    random = np.random.default_rng(0)
    clouds = [random.uniform(-0.5, 0.5, (500, 3)) * sides for sides in ([1, 1, 1], [1, 0.2, 0.5], [0.3, 1, 0.3])]
    grids = np.stack([occupancy(cloud) for cloud in clouds])
    assert np.allclose(grids.sum(1), 1)
    for i, grid in enumerate(grids):
        like = overlap(grid, grids)
        assert like[i] == pytest.approx(1) and like.argmax() == i and (like >= 0).all()
        assert cosine(grid, 3 * grids)[i] == pytest.approx(1)
    assert np.allclose(standardised(np.full(4, 2.0)), 0) and standardised(np.arange(5.0)).std() == pytest.approx(1)


def bare_boxes(folder: Path, count: int, annotated: int) -> Path:
    path = make_boxes(folder, count)
    file = folder / "shapes" / "keypoints.json"
    file.write_text(json.dumps(json.loads(file.read_text())[:annotated]))
    return path


def test_without_anything_stored_shapes_come_by_name(tmp_path: Path) -> None:
    run = Run.load(bare_boxes(tmp_path, 5, 1))
    assert looks_of(run, [shape.name for shape in run.shapes]).names == []
    walk = Walk(run)
    assert walk.first == "box/b1" and walk.around("box/b1")["told"] == "box: 1 of 2 shots annotated"


@pytest.mark.parametrize(("until", "told"), [("normalize", "geometry alone"), ("reweight", "features and geometry")])
@pytest.mark.parametrize("annotated", [0, 1])
def test_what_is_stored_decides(tmp_path: Path, until: str, told: str, annotated: int) -> None:
    path = bare_boxes(tmp_path, 5, annotated)
    Run.load(path).execute(workers=0, selection=Selection(until=until))  # what needs shots is blocked
    walk = Walk(Run.load(path))
    around = walk.around(walk.first)
    assert told in (around["told"] or "")
    assert walk.first in ("box/b1", "box/b2", "box/b3") or annotated, "no extreme"
    needs = walk.needs()[0]
    assert sorted(needs.order) == [f"box/b{i}" for i in range(5)] and needs.order[:annotated] == ["box/b0"][:annotated]
    assert needs.needed[0] == walk.first and needs.order != sorted(needs.order)
