"""Run: a run file made ready to plan, execute and open. What the command line does, as a Python API.

>>> run = Run.load("runs/demo.toml")
>>> run.execute()
>>> run.artifact("chair/chair-0003", "reweight").features
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

from b23d.pipeline.address import canonical_json, sha256
from b23d.pipeline.config import Config, feeding, load_config
from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import ArtifactNotFoundError, RunFileError
from b23d.pipeline.frontier import Frontier
from b23d.pipeline.index import Failure, Index
from b23d.pipeline.members import SUFFIX
from b23d.pipeline.plan import Node, Plan, State
from b23d.pipeline.planning import make_plan
from b23d.pipeline.scheduler import DaskExecutor, Executor, InlineExecutor
from b23d.pipeline.selection import EVERYTHING, Selection
from b23d.pipeline.store import Store
from b23d.pipeline.tasks import Outcome, Task, make_task
from b23d.schemas.artifact import Artifact


@dataclass
class Report:
    """What an execution did."""

    seconds: float = 0.0
    done: list[Outcome] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    blocked: int = 0

    @property
    def ok(self) -> bool:
        return not self.failures and not self.blocked


class Run:
    """One run file with its overrides, its data set and its store."""

    def __init__(self, config: Config, store: str | None = None) -> None:
        self.config = config
        self.store = Store(store or config.file.store.root)
        self.folder = config.path.parent / config.file.name

    @classmethod
    def load(cls, path: str | Path, overrides: Iterable[str] = (), store: str | None = None) -> Run:
        """Raises FileNotFoundError or RunFileError where the run file does not say what it should."""
        return cls(load_config(path, overrides), store)

    @property
    def name(self) -> str:
        return self.config.file.name

    @cached_property
    def shapes(self) -> list[Shape]:
        shapes = self.config.dataset.shapes()
        if not shapes:
            raise RunFileError(f"run {self.name}: expected a data set with shapes, got none; check [dataset]")
        return shapes

    @cached_property
    def index(self) -> Index:
        """Beside a local store; below the run's folder for one in an object store."""
        folder = Path(self.store.root) if self.store.local else self.folder
        return Index(folder / "index.sqlite")

    def plan(self, selection: Selection = EVERYTHING) -> Plan:
        """What is there and what is missing; nothing is executed."""
        return make_plan(self.config, self.shapes, self.store, self.index, selection)

    def execute(
        self,
        workers: int | None = None,
        scheduler: str | None = None,
        selection: Selection = EVERYTHING,
        watch: Callable[[Plan, Outcome | None], None] = lambda plan, outcome: None,
        on_start: Callable[[Plan, str], None] = lambda plan, address: None,
    ) -> Report:
        """Do what is missing. Failed shapes are quarantined, the rest goes on.

        `workers=0`: in this process. `on_start` hears the plan and the executor's address, `watch` every outcome.
        Raises PermissionError where the store cannot be written, ResourceError where no worker has what a stage needs.
        """
        started = time.perf_counter()
        self.store.check_writable()
        self.store.sweep()
        report, executor, whole = Report(), None, False
        plan = self.plan(selection)
        try:
            while plan.to_run():
                executor = executor or self._executor(workers, scheduler)
                on_start(plan, executor.address)
                failed = self._execute(plan, executor, report, watch)
                # A shot that cannot be used is replaced by the next in rank: with its failure known, plan once more.
                shots = {shot.name for draw in plan.draws for shot in draw.shots}
                selection = replace(selection, force=False)
                again = self.plan(selection)
                if not shots & {failure.shape for failure in failed if failure.permanent}:
                    plan = again
                    break
                plan = again
            whole = True
        finally:
            if executor is not None:
                executor.close(at_once=not whole)
        known = {failure.address for failure in report.failures}
        report.failures += [
            problem for problem in plan.problems if problem.address not in known or problem.stage in ("source", "draw")
        ]
        report.blocked = plan_blocked(plan)
        report.seconds = time.perf_counter() - started
        self._save(plan, report)
        return report

    def artifact(self, shape: str, stage: str, draw: int | None = None) -> Artifact:
        """The artifact of (shape, stage), its arrays read when touched; of the first draw that has one, if none is
        named.

        Raises KeyError where the run has no such shape or stage, ArtifactNotFoundError where it has not been made.
        """
        node = self.node(shape, stage, draw)
        return self.store.read(node.stage, node.address, self.config.stages[node.stage].gives)

    def node(self, shape: str, stage: str, draw: int | None = None) -> Node:
        """The plan's node of (shape, stage)."""
        stage = feeding(self.config.file, stage)
        if stage not in self.config.stages:
            raise KeyError(f"stage: expected one of {', '.join(self.config.stages)}, got {stage!r}; check the name")
        found = [
            node
            for (s, name, d), node in self._plan.by_shape.items()
            if s == stage and name == shape and draw in (None, d)
        ]
        if not found:
            names = [s.name for s in self.shapes if shape in s.name]
            hint = "a shot has no prediction in its own draw, and no score without keypoints"
            if shape not in names:
                hint = f"did you mean {names[0]!r}?" if names else f"for example {self.shapes[0].name!r}"
            raise KeyError(f"shape: expected one of run {self.name} that has {stage}, got {shape!r}; {hint}")
        present = [node for node in found if node.state is State.CACHED]
        return (present or found)[0]

    def collect(self, stage: str) -> Iterator[tuple[Shape, int | None, Artifact]]:
        """(shape, draw, artifact) of everything a stage has made in this run."""
        stage = feeding(self.config.file, stage)
        shapes = {shape.name: shape for shape in self.shapes}
        for (name, shape, draw), node in self._plan.by_shape.items():
            if name == stage and node.state is State.CACHED:
                try:
                    yield shapes[shape], draw, self.store.read(stage, node.address, self.config.stages[stage].gives)
                except ArtifactNotFoundError:
                    continue

    @cached_property
    def _plan(self) -> Plan:
        return self.plan()

    def _executor(self, workers: int | None, scheduler: str | None) -> Executor:
        options = self.config.file.execution
        update = {key: value for key, value in (("workers", workers), ("scheduler", scheduler)) if value is not None}
        options = options.model_copy(update=update)
        if options.workers == 0 and not options.scheduler:
            return InlineExecutor()
        return DaskExecutor(options, {name: stage.hints for name, stage in self.config.stages.items()})

    def _execute(
        self, plan: Plan, executor: Executor, report: Report, watch: Callable[[Plan, Outcome | None], None]
    ) -> list[Failure]:
        for node in plan.to_run():
            if node.forced:
                self.store.delete(node.stage, node.address)
        frontier, failed = Frontier(plan), []

        def next_task() -> Task | None:
            node = frontier.pop()
            return None if node is None else make_task(node, self.config.params, self.store.url)

        for outcome in executor.run(next_task):
            if outcome.failure is None:
                self.index.record(
                    outcome.stage,
                    outcome.address,
                    outcome.shape,
                    outcome.seconds,
                    outcome.stored_bytes,
                    outcome.peak_mb,
                )
                frontier.done(outcome.stage, outcome.address)
                report.done.append(outcome)
            else:
                self.index.quarantine(outcome.failure)
                frontier.failed(outcome.stage, outcome.address)
                failed.append(outcome.failure)
                report.failures.append(outcome.failure)
            watch(plan, outcome)
        return failed

    def _save(self, plan: Plan, report: Report) -> None:
        """`manifest.json` in the run's folder: what this run is, what it reaches, what failed. Members of a series
        share a folder and have one each."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.index.note_run_file(self.config.path)
        manifest = {
            "run": self.name,
            "file": self.config.file.model_dump(mode="json"),
            "params": {name: params.model_dump(mode="json") for name, params in self.config.params.items()},
            "store": self.store.url,
            "overrides": list(self.config.overrides),
            "addresses": {
                stage: sorted({n.address for n in plan.nodes.values() if n.stage == stage}) for stage in plan.stages
            },
            "draws": {f"{d.category}/{d.seed}": [shot.id for shot in d.shots] for d in plan.draws},
            "failures": [asdict(failure) for failure in report.failures],
        }
        name = (
            f"manifest-{sha256(canonical_json(manifest['overrides']))[:12]}"
            if self.name.endswith(SUFFIX)
            else "manifest"
        )
        (self.folder / f"{name}.json").write_text(json.dumps(manifest, indent=1))
        self.__dict__.pop("_plan", None)


def plan_blocked(plan: Plan) -> int:
    """Nodes that cannot run for what is known to be wrong above them."""
    return sum(node.state is State.BLOCKED for node in plan.nodes.values())
