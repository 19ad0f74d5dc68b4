"""Run: a run file made ready to plan, execute and open. What the command line does, as a Python API.

>>> run = Run.load("runs/demo.toml")
>>> run.execute()
>>> run.artifact("chair/chair-0003", "reweight").features
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import cached_property
from pathlib import Path

from b23d.pipeline.address import canonical_json, sha256
from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import ArtifactNotFoundError, RunFileError
from b23d.pipeline.planning.absent import why_absent
from b23d.pipeline.planning.hinting import hint
from b23d.pipeline.planning.making import Accepting, make_plan
from b23d.pipeline.planning.nodes import Node, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.records.history import begin, finish, stopped
from b23d.pipeline.records.runlog import RunLog, both
from b23d.pipeline.records.warned import remember, warnings
from b23d.pipeline.runfile.anchoring import absolute
from b23d.pipeline.runfile.config import Config, feeding, load_config
from b23d.pipeline.runfile.members import SUFFIX
from b23d.pipeline.scheduling.execution import Report, RunLoop
from b23d.pipeline.scheduling.scheduler import DaskExecutor, Executor, InlineExecutor
from b23d.pipeline.scheduling.stopping import Stopped
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.pipeline.stage import load_stages_once
from b23d.pipeline.storage.index import Index
from b23d.pipeline.store import Store
from b23d.schemas.artifact import Artifact

log = logging.getLogger("b23d")


class Run:
    """One run file with its overrides, its data set and its store."""

    def __init__(self, config: Config, store: str | None = None) -> None:
        self.config = config
        self.store = Store(absolute(store, Path.cwd()) if store else config.file.store.root)
        self.store.check_format()
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
        shapes = self.config.dataset.listed()
        if not shapes:
            raise RunFileError(f"run {self.name}: expected a data set with shapes, got none; check [dataset]")
        return shapes

    @cached_property
    def index(self) -> Index:
        """Beside a local store; below the run's folder for one in an object store."""
        return Index(self._index_path(), write=False)

    def plan(self, selection: Selection = EVERYTHING, accepting: Accepting | None = None) -> Plan:
        """What is there and what is missing; nothing is executed. `accepting`: as if these older versions were."""
        _check(selection)
        return make_plan(self.config, self.shapes, self.store, self.index, selection, accepting)

    def execute(
        self,
        workers: int | None = None,
        scheduler: str | None = None,
        selection: Selection = EVERYTHING,
        watch: Callable[[Plan, Outcome | Task], None] = lambda plan, what: None,
        on_start: Callable[[Plan, str], None] = lambda plan, address: None,
    ) -> Report:
        """Do what is missing. Failed shapes are quarantined, the rest goes on.

        `workers=0`: in this process. `on_start` hears the plan and the executor's address, `watch` every task
        that is given to a worker and every outcome; both are written to `run.log` in the run's folder, too.
        Raises StoreError where the store cannot be written, ResourceError where no worker has what a stage needs.
        """
        _check(selection)
        self.open_to_write()
        self.store.drop_leftovers()
        record, started = begin(self.store, self.config, selection), time.perf_counter()
        try:
            with RunLog(self.folder, self.name, selection.words) as log:
                loop = RunLoop(self, selection, both(log.watch, watch), both(log.start, on_start))
                plan, report = loop.go(lambda: self._executor(workers, scheduler))
        except BaseException as error:
            why = (
                "stopped"
                if isinstance(error, KeyboardInterrupt | SystemExit | Stopped)
                else f"{type(error).__name__}: {error}"
            )
            stopped(self.store, record, time.perf_counter() - started, why)
            raise
        report.plan = plan
        report.record = finish(self.store, record, plan, report).id
        self._save(plan, report)
        remember(self.folder, report.done)
        report.warnings = warnings(self.folder, plan)
        return report

    def open_to_write(self) -> None:
        """Raises StoreError where the store cannot be written. Until it is called, nothing is."""
        self.store.check_writable()
        self.__dict__.pop("_plan", None)
        if "index" in self.__dict__:
            self.index.close()
        self.index = Index(self._index_path(), write=True)

    def _index_path(self) -> Path:
        return (Path(self.store.root) if self.store.local else self.folder) / "index.sqlite"

    def artifact(self, shape: str, stage: str, draw: int | None = None) -> Artifact:
        """The artifact of (shape, stage), its arrays read when touched; of the first draw that has one, if none is
        named.

        Raises KeyError where the run has no such shape or stage, ArtifactNotFoundError where it has not been made.
        """
        node = self.node(shape, stage, draw)
        return self.store.read(node.stage, node.address, self.config.stages[node.stage].gives)

    def node(self, shape: str, stage: str, draw: int | None = None) -> Node:
        """The plan's node of (shape, stage)."""
        stage = feeding(self.config.file, stage) if isinstance(stage, str) else stage
        if not isinstance(stage, str) or stage not in self.config.stages:
            raise KeyError(self._no_stage(stage))
        found = [
            node
            for (s, name, d), node in self._plan.by_shape.items()
            if s == stage and name == shape and draw in (None, d)
        ]
        if not found:
            having = sorted({name for s, name, d in self._plan.by_shape if s == stage and draw in (None, d)})
            known = next((each for each in self.shapes if each.name == shape), None)
            if known is None:
                example = f"for example {having[0]!r}" if having else "none has"
                why = hint(shape, having, hint(shape, [each.name for each in self.shapes], example))
            else:
                why = why_absent(self._plan, known, stage, draw)
            raise KeyError(f"shape: expected one of run {self.name} that has {stage}, got {shape!r}; {why}")
        present = [node for node in found if node.state is State.CACHED]
        return (present or found)[0]

    def collect(self, stage: str) -> Iterator[tuple[Shape, int | None, Artifact]]:
        """(shape, draw, artifact) of everything a stage has made in this run. Raises KeyError where there is no such
        stage."""
        if not isinstance(stage, str) or feeding(self.config.file, stage) not in load_stages_once():
            raise KeyError(self._no_stage(stage))
        stage = feeding(self.config.file, stage)
        shapes = {shape.name: shape for shape in self.shapes}
        for (name, shape, draw), node in self._plan.by_shape.items():
            if name == stage and node.state is State.CACHED:
                try:
                    yield shapes[shape], draw, self.store.read(stage, node.address, self.config.stages[stage].gives)
                except ArtifactNotFoundError:
                    continue

    def _no_stage(self, stage: object) -> str:
        near = hint(str(stage), list(self.config.stages), "check the name")
        return f"stage: expected one of {', '.join(self.config.stages)}, got {stage!r}; {near}"

    @cached_property
    def _plan(self) -> Plan:
        return self.plan()

    def _executor(self, workers: int | None, scheduler: str | None) -> Executor:
        options = self.config.file.execution
        update = {key: value for key, value in (("workers", workers), ("scheduler", scheduler)) if value is not None}
        options = options.model_copy(update=update)
        if options.workers == 0 and not options.scheduler:
            return InlineExecutor()
        hints = {name: stage.hints for name, stage in self.config.stages.items()}
        return DaskExecutor(options, hints, self.config.plugins)

    def _save(self, plan: Plan, report: Report) -> None:
        """`manifest.json` in the run's folder: what this run is, what it reaches, what failed. Members of a series
        share a folder and have one each."""
        manifest = {
            "run": self.name,
            "file": self.config.file.model_dump(mode="json"),
            "params": {name: params.model_dump(mode="json") for name, params in self.config.params.items()},
            "store": self.store.url,
            "overrides": list(self.config.overrides),
            "addresses": {
                stage: sorted(address for name, address in plan.reached() if name == stage) for stage in plan.stages
            },
            "draws": {f"{d.category}/{d.seed}": [shot.id for shot in d.shots] for d in plan.draws},
            "failures": [asdict(failure) for failure in report.failures],
        }
        name = (
            f"manifest-{sha256(canonical_json(manifest['overrides']))[:12]}"
            if self.name.endswith(SUFFIX)
            else "manifest"
        )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / f"{name}.json").write_text(json.dumps(manifest, indent=1))
        except OSError as error:
            log.warning("%s: expected room for %s.json, got %s; the artifacts are stored", self.folder, name, error)
        self.__dict__.pop("_plan", None)


def _check(selection: object) -> None:
    """Raises TypeError where it is no Selection."""
    if not isinstance(selection, Selection):
        example = "Selection(shapes=('chair/*',), until='extract')"
        raise TypeError(f"selection: expected a Selection, got {selection!r}; for example {example}")
