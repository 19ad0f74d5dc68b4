"""Execution: what a plan still wants, done, until nothing is left that can be done.

A shape that fails is quarantined and the rest goes on. A shot that cannot be used is replaced by the next in rank, what
failed once and now succeeds frees what was blocked behind it, and a damaged input is set aside to be made again: each
time the plan is made anew. What another run makes just now is left to it. Only a store that fails stops everything:
that would happen to every shape in turn.
"""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from b23d.pipeline.errors import StoreError
from b23d.pipeline.planning.nodes import SHOTS, Node, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.runfile.config import Config
from b23d.pipeline.scheduling.batches import Batches
from b23d.pipeline.scheduling.frontier import Frontier, needed
from b23d.pipeline.scheduling.scheduler import Executor
from b23d.pipeline.scheduling.sharing import Sharing
from b23d.pipeline.scheduling.tasks import Outcome, Task, make_task
from b23d.pipeline.storage.index import Failure, Given, Index
from b23d.pipeline.storage.marker import store_format
from b23d.pipeline.storage.roots import lease, note_root
from b23d.pipeline.store import Store
from b23d.schemas.wording import counted

log = logging.getLogger("b23d")


class Executable(Protocol):
    """What an execution has to know of a run: what it is, where its artifacts lie, and, again and again, its plan."""

    config: Config
    store: Store

    @property
    def index(self) -> Index: ...

    def plan(self, selection: Selection = EVERYTHING) -> Plan: ...


@dataclass
class Report:
    """What an execution did."""

    seconds: float = 0.0
    done: list[Outcome] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    spared: list[Outcome] = field(default_factory=list)
    """What needed not run after all: something above was made anew and gave what was known."""
    blocked: int = 0
    """Tasks that could not be tried, for what failed above them."""
    warnings: list[str] = field(default_factory=list)
    """What stages found odd and let pass, in this run and before."""
    elsewhere: int = 0
    """Artifacts that another run made meanwhile."""
    record: str = ""
    """Id of the record that this execution has left (see `pipeline/records/history.py`)."""
    selection: Selection = EVERYTHING
    """What was asked for."""
    plan: Plan | None = None
    """What is there, and what is not, now that all is done; None until then."""

    @property
    def ok(self) -> bool:
        return not self.failures and not self.blocked


class RunLoop:
    """One execution of a run. `watch` hears of every task given out and every outcome, `on_start` of each plan and of
    the executor's address."""

    def __init__(
        self,
        run: Executable,
        selection: Selection,
        watch: Callable[[Plan, Outcome | Task], None],
        on_start: Callable[[Plan, str], None],
    ) -> None:
        self.run, self.selection, self.watch, self.on_start = run, selection, watch, on_start
        self.report = Report(selection=selection)
        self._tried: set[tuple[str, str]] = set()
        """What has failed in this execution: not tried again in it."""
        self._healed: dict[tuple[str, str], int] = {}
        """What was damaged and is made again → in which round."""
        self._round = 0
        self._whole = False
        self._total, self._started = 0, time.perf_counter()
        self._running: dict[tuple[str, str], str] = {}
        """What workers have in hand, in words."""
        self._making: dict[str, list[Node]] = {}
        """Key of each task under way → nodes made of the very same, which wait for it."""
        self._seconds: dict[str, dict[str, float]] = {}
        self._made: dict[str, set[str] | None] = {}
        """Stage → shapes of which it had made something before; None: the index does not know all of them."""

    def go(self, make_executor: Callable[[], Executor]) -> tuple[Plan, Report]:
        """Raises StoreError where the store fails; what is finished is stored."""
        self._started, executor = time.perf_counter(), None
        plan = self.run.plan(self.selection)
        with ExitStack() as stack:
            gc.freeze()  # the collector need not go through hundreds of thousands of nodes again and again
            stack.callback(gc.unfreeze)
            held = stack.enter_context(lease(self.run.store, self._note(plan), self._progress))
            self._sharing = Sharing(self.run.store, held)
            stack.callback(self._sharing.end)
            while left := self._left(plan):
                self._total = len(self.report.done) + len(left)
                if executor is None:
                    executor = make_executor()
                    stack.callback(self._close, executor)
                self.on_start(plan, executor.address)
                self._round += 1
                before = self._steps()
                self._do(plan, executor)
                waited = self._sharing.wait()
                self.selection = replace(self.selection, force=False)
                again = self.run.plan(self.selection)
                if again.nodes.keys() != plan.nodes.keys():
                    self._note(again)
                plan = again
                if not waited and before == self._steps():
                    break  # what is left waits for what has failed
            self._whole = True
            self._note(plan, ended=True)
        known = {failure.address for failure in self.report.failures}
        self.report.failures += [
            problem
            for problem in plan.problems
            if problem.address not in known or problem.stage in ("source", "draw", SHOTS)
        ]
        blocked = sum(node.state is State.BLOCKED for node in plan.nodes.values())
        self.report.blocked = blocked + len(self._left(plan))
        self.report.elsewhere = self._sharing.given
        self.report.seconds = time.perf_counter() - self._started
        return plan, self.report

    def _progress(self) -> dict[str, Any]:
        """How far this execution is, for whoever asks `b23d status`."""
        return {
            "run": self.run.config.file.name,
            "overrides": list(self.run.config.overrides),
            "done": len(self.report.done) + len(self.report.spared),
            "total": self._total,
            "failed": len(self.report.failures),
            "seconds": round(time.perf_counter() - self._started, 1),
            "running": list(self._running.values()),
        }

    def _steps(self) -> int:
        return len(self.report.done) + len(self.report.spared) + len(self._tried) + len(self._healed)

    def _close(self, executor: Executor) -> None:
        executor.close(at_once=not self._whole)

    def _left(self, plan: Plan) -> list[Node]:
        return [node for node in plan.to_run() if (node.stage, node.recipe) not in self._tried]

    def _note(self, plan: Plan, ended: bool = False) -> str:
        """Before the first task, so that `gc` keeps what it makes: all that the run reaches, targets left out by
        the selection too."""
        reached: dict[str, set[str]] = {stage: set() for stage in self.run.config.stages}
        for stage, address in plan.reached() | (self.run.plan().reached() if self.selection != EVERYTHING else set()):
            reached[stage].add(address)
        config = self.run.config
        addresses = {stage: sorted(made) for stage, made in reached.items()}
        return note_root(self.run.store, config.path, config.overrides, addresses, besides=not ended)

    def _do(self, plan: Plan, executor: Executor) -> None:
        for node in plan.to_run():
            if node.forced:
                self.run.store.delete(node.stage, node.address)
        frontier, self._making = Frontier(plan), {}
        for stage, recipe in self._tried:
            frontier.failed(stage, recipe)
        batches = Batches(frontier, executor.lane, lambda node: self._may_be_spared(plan, node))
        for outcome in executor.run(lambda slots: self._batch(plan, frontier, batches, slots)):
            batches.heard(outcome)
            self._running.pop((outcome.stage, outcome.address), None)
            self._sharing.release(outcome.stage, outcome.address)
            waiting = self._making.pop(plan.nodes[outcome.stage, outcome.address].key or "", [])
            if outcome.failure is None:
                self._done(plan, outcome)
                frontier.done(outcome.stage, outcome.address)
                for node in waiting:
                    self._spare(plan, frontier, node, outcome.address)
            else:
                for node in waiting:
                    frontier.again(node)
                frontier.failed(outcome.stage, outcome.address)
                if self._heal(outcome.failure):
                    continue
                self._failed(outcome.failure)
            self.watch(plan, outcome)

    def _batch(self, plan: Plan, frontier: Frontier, batches: Batches, slots: int) -> list[Task]:
        """Tasks that go to a worker together; none: nothing is ready just now."""
        while nodes := batches.next(slots):
            untried = [node for node in nodes if (node.stage, node.recipe) not in self._tried]
            if nodes := self._sharing.ours(self._unknown(plan, frontier, untried)):
                self._running.update({(node.stage, node.recipe): f"{node.stage} of {node.shape}" for node in nodes})
                tasks = [make_task(node, self.run.config.params, self.run.store.url) for node in nodes]
                for task in tasks:
                    self.watch(plan, task)
                return tasks
        return []

    def _unknown(self, plan: Plan, frontier: Frontier, nodes: list[Node]) -> list[Node]:
        """Of nodes in the order to make them in, those that are to be made: what turns out to be stored is spared, what
        is made of the same as another under way waits for it, and what needs that goes back."""
        unknown: list[Node] = []
        waiting: set[tuple[str, str]] = set()
        for node in nodes:
            if not waiting.isdisjoint(needed(node)):
                frontier.hand_back(node)
                waiting.add((node.stage, node.recipe))
                continue
            key = plan.contents.key(node)
            if key is not None and not node.forced:
                if (at := plan.contents.found(node)) is not None:
                    self._spare(plan, frontier, node, at)
                    continue
                if key in self._making:
                    self._making[key].append(node)
                    waiting.add((node.stage, node.recipe))
                    continue
                self._making[key] = []
            unknown.append(node)
        return unknown

    def _may_be_spared(self, plan: Plan, node: Node) -> bool:
        """Whether it should be looked at again once what it needs is made: something was made of this shape before, or
        of who knows which."""
        if node.stage not in self._made:
            made = self.run.index.shapes(node.stage)
            known = {address for address, *_ in self.run.index.history(node.stage)}
            self._made[node.stage] = made if plan.contents.present[node.stage] <= known else None
        shapes = self._made[node.stage]
        return node.behind and (shapes is None or node.shape in shapes)

    def _done(self, plan: Plan, outcome: Outcome) -> None:
        node = plan.nodes[outcome.stage, outcome.address]
        given = Given(outcome.content, plan.contents.key(node))
        self.report.done.append(outcome)
        self.run.index.record(
            outcome.stage,
            outcome.address,
            outcome.shape,
            outcome.seconds,
            outcome.stored_bytes,
            outcome.peak_mb,
            given,
        )
        plan.contents.note(outcome.stage, outcome.address, given)
        node.state = State.CACHED

    def _spare(self, plan: Plan, frontier: Frontier, node: Node, at: str) -> None:
        """What a node would give is stored: nothing is to be done."""
        node.state, node.address = State.CACHED, at
        if node.stage not in self._seconds:
            self._seconds[node.stage] = {a: seconds for a, seconds, *_ in self.run.index.history(node.stage)}
        seconds = self._seconds[node.stage].get(at, 0.0)
        outcome = Outcome(node.stage, node.recipe, node.shape, seconds, key=node.key, spared=True)
        self.report.spared.append(outcome)
        frontier.done(node.stage, node.recipe)
        self.watch(plan, outcome)

    def _failed(self, failure: Failure) -> None:
        if failure.store:
            error = failure.error.partition(": ")[2]
            raise StoreError(
                f"{error}; stopped with {counted(len(self.report.done), 'task')} stored, "
                "run again to go on where it was"
            )
        self._tried.add((failure.stage, failure.address))
        self.report.failures.append(failure)
        self.run.index.quarantine(failure)

    def _heal(self, failure: Failure) -> bool:
        """Set a damaged input aside, once, so that the next round makes it again."""
        if failure.damaged is None or self._healed.get(failure.damaged, self._round) != self._round:
            return False
        store = self.run.store
        if store_format(store.fs, store.root) is None:
            raise StoreError(f"store: expected {store.url} to stay where it was, got nothing there; bring it back")
        if failure.damaged not in self._healed:
            stage, address = failure.damaged
            log.warning("%s %s: damaged, and made again (%s)", stage, address[:12], failure.error)
            store.delete(stage, address)
            self.run.index.forget([address])
        self._healed[failure.damaged] = self._round
        return True
