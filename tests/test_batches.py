"""Tasks that go to a worker together: each is still made once, in order, stored, counted and quarantined by itself."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.planning.nodes import Node
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling import batches as policy
from b23d.pipeline.scheduling.batches import Batches
from b23d.pipeline.scheduling.frontier import Frontier, needed
from b23d.pipeline.scheduling.tasks import Outcome, make_task
from b23d.pipeline.scheduling.worker import as_stored, run_tasks
from tests.toy import Numbers, make_idle, make_toy


def drive(
    run: Run, slots: int, seed: int, failing: float = 0.1, took: tuple[float, ...] = (0.0001, 0.01, 1.0)
) -> tuple[list[list[Node]], set[Node]]:
    """All batches of a run whose outcomes are made up: some seconds, some failures, in any order of batches."""
    plan, chance = run.plan(), random.Random(seed)
    frontier = Frontier(plan)
    batches, given, running = Batches(frontier, lambda stage: stage == "add"), list[list[Node]](), list[list[Node]]()
    failed: set[Node] = set()
    while True:
        while len(running) < 2 * slots and (batch := batches.next(slots)):
            given.append(batch)
            running.append(batch)
        if not running:
            return given, failed
        lost: set[tuple[str, str]] = set()
        for node in running.pop(chance.randrange(len(running))):
            key = (node.stage, node.recipe)
            if lost & set(needed(node)):
                lost.add(key)
            elif chance.random() < failing:
                lost.add(key)
                failed.add(node)
                frontier.failed(*key)
            else:
                batches.heard(Outcome(node.stage, node.recipe, node.shape, chance.choice(took)))
                frontier.done(*key)


@pytest.mark.parametrize("seed", range(20))
def test_everything_is_given_out_once_and_after_what_it_needs(tmp_path: Path, seed: int) -> None:
    path = make_toy(tmp_path, count=30) if seed % 2 else make_idle(tmp_path, 30)
    run = Run.load(path)
    given, failed = drive(run, 1 + seed % 4, seed)
    nodes = [node for batch in given for node in batch]
    assert len(nodes) == len(set(nodes))
    place = {(node.stage, node.recipe): number for number, node in enumerate(nodes)}
    assert all(place[key] < place[node.stage, node.recipe] for node in nodes for key in needed(node))
    assert all(len({node.stage == "add" for node in batch}) == 1 for batch in given), "a batch is of one lane"
    below, grown = {(node.stage, node.recipe) for node in failed}, True
    while grown:
        more = {(n.stage, n.recipe) for n in run.plan().to_run() if below & set(needed(n))} - below
        below, grown = below | more, bool(more)
    assert {(n.stage, n.recipe) for n in run.plan().to_run()} == place.keys() | below, "only what failed keeps back"


def test_a_chain_goes_as_one_and_short_tasks_go_together(tmp_path: Path) -> None:
    given, _ = drive(Run.load(make_idle(tmp_path, 100)), 2, 0, failing=0, took=(0.0001,))
    assert [node.stage for node in given[0]] == [f"idle{i}" for i in range(8)]
    assert max(map(len, given)) > 50 and len(given) < 80


@pytest.mark.parametrize("workers", [0, 2])
def test_what_batches_make_is_what_single_tasks_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    together = Run.load(make_toy(tmp_path, count=12))
    assert together.execute(workers=workers).ok
    monkeypatch.setattr(policy, "SHORT", 0.0)
    monkeypatch.setattr(policy, "LONG", 0.0)
    alone = Run.load(make_toy(tmp_path), store=str(tmp_path / "alone"))
    assert alone.execute(workers=0).ok

    def stored(run: Run) -> dict[tuple[str, str], tuple[object, dict[str, str]]]:
        heads = {
            (stage, a): run.store.head(stage, a) for stage in run.store.stages() for a in run.store.addresses(stage)
        }
        return {
            key: (head.values, {name: array.sha256 for name, array in head.arrays.items()})
            for key, head in heads.items()
        }

    assert stored(together) == stored(alone)


def test_a_failure_inside_a_chain_is_its_own(tmp_path: Path) -> None:
    """What is before it is stored, what needs it is not tried, its neighbours go on."""
    path = make_toy(tmp_path)
    (tmp_path / "numbers" / "bad.txt").write_text("-13 1")
    run = Run.load(path)
    run.open_to_write()
    plan = run.plan()
    nodes = [node for node in plan.to_run() if node.shape in ("toy/bad", "toy/s1") and node.stage != "add"]
    tasks = [make_task(node, run.config.params, run.store.url) for node in nodes]
    outcomes = [(o.stage, o.shape, o.failure is None) for o in run_tasks(tasks)]
    assert ("square", "toy/bad", False) in outcomes and ("shift", "toy/bad", True) not in outcomes
    assert ("square", "toy/s1", True) in outcomes and ("shift", "toy/s1", True) in outcomes and len(outcomes) == 3


def test_what_the_next_task_gets_is_what_the_store_would_give(tmp_path: Path) -> None:
    """Arrays in C order and plain JSON values: results must not hang on who was in one batch."""
    made = Numbers(values=np.arange(6.0)[::2], grid=np.asfortranarray(np.ones((2, 3), np.float32)), note="ü")
    store = Run.load(make_toy(tmp_path)).store
    store.write("square", "ab" * 32, made, {})
    read, given = store.read("square", "ab" * 32, Numbers), as_stored(made, Numbers)
    assert isinstance(given, Numbers) and given.note == read.note
    for name, value in read.present_arrays().items():
        here = given.present_arrays()[name]
        np.testing.assert_array_equal(here, value)
        assert here.flags.c_contiguous and value.flags.c_contiguous and here.dtype == value.dtype
