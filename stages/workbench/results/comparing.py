"""A comparison: the systems that a run file's variants name, with what the store has of each, scored on the same
targets."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from b23d.pipeline.errors import B23dError
from b23d.pipeline.planning.nodes import SHOTS
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.pipeline.runfile.members import VARIANTS, Member
from b23d.schemas.scores import PartTable, ScoreTable
from b23d.schemas.wording import counted
from b23d.stages.workbench.results.gathering import failures
from b23d.stages.workbench.results.summary import costs

if TYPE_CHECKING:
    from b23d.stages.scoring.summary import ScoreRow

ScoreKey = tuple[str, Hashable, str]
"""Class, draw, shape."""
UNUSABLE = (B23dError, OSError, ValueError, ImportError)
"""What keeps a system from running: weights or files that are not there, a package that is missing, settings that do
not fit."""
MOST = 0.5
"""A system that has scored less than this share of the targets is not compared on common ground: it would take it from
the others."""


@dataclass(frozen=True)
class System:
    """One row of a comparison."""

    label: str
    group: str
    """What stands before the first "/" of the label; "" for a reference, which every group shows."""
    kind: Literal["keypoints", "parts"] = "keypoints"
    """What it predicts."""
    changes: dict[str, str] = field(default_factory=dict)
    """What sets it apart: dotted field → value."""
    scores: ScoreTable | None = None
    parts: PartTable | None = None
    seconds: float | None = None
    """Computing time per target, everything that was made for it included; None where nothing was."""
    reason: str = ""
    """Why there is no figure."""
    note: str = ""
    """What its figures lack."""

    @property
    def name(self) -> str:
        return self.label.removeprefix(f"{self.group}/")

    @property
    def shown(self) -> bool:
        return self.scores is not None or self.parts is not None


@dataclass(frozen=True)
class Comparison:
    systems: list[System]
    left_out: int = 0
    """Targets (in a draw) that some system has scored and another has not: they count for none."""
    targets: int = 0
    """Those that count."""

    def groups(self) -> dict[str, list[System]]:
        """The systems of each group, the references first, in the run file's order."""
        references = [system for system in self.systems if not system.group]
        named = list(dict.fromkeys(system.group for system in self.systems if system.group))
        if not named:
            return {VARIANTS: references} if references else {}
        of = {name: [system for system in self.systems if system.group == name] for name in named}
        return {name: [*(r for r in references if _alike(r, systems)), *systems] for name, systems in of.items()}

    def as_json(self) -> str:
        """A list of {system, group, kind, changes, seconds, reason, note, scores, parts}; scores as `b23d scores
        --json` prints them."""
        return json.dumps([_plain(system) for system in self.systems], indent=1)


def compare(path: Path, members: Iterable[Member], store: str | None = None, limit: int | None = None) -> Comparison:
    """What the store has of every member; nothing is executed. `limit`: as `Run.plan`'s."""
    systems, rows = [], {}
    for member in members:
        system, found = _system(path, member, store, limit)
        systems.append(system)
        if found:
            rows[system.label] = {row[:3]: row for row in found}
    every = set().union(*rows.values()) if rows else set()
    full = [label for label, scored in rows.items() if len(scored) >= MOST * len(every)]
    shared: set[ScoreKey] = set.intersection(*(set(rows[label]) for label in full)) if full else set()
    systems = [_scored(system, rows[system.label], shared) if system.label in rows else system for system in systems]
    return Comparison(systems, len(every) - len(shared), len(shared))


def group_of(member: Member) -> str:
    """A variant's group stands before the first "/" of its name; a sweep's is the swept field."""
    if member.series != VARIANTS:
        return member.series
    return member.label.partition("/")[0] if "/" in member.label else ""


def reason_of(error: BaseException) -> str:
    """An error in one line."""
    return " ".join(str(error).split()) or type(error).__name__


def unmade(run: Run, plan: Plan) -> str:
    """Why a run has no scores: its first failure, or "" where it was not run."""
    known = failures(run, plan)
    return "" if not known else f"{known[0].shape}, {known[0].stage}: {known[0].error}"


def _system(path: Path, member: Member, store: str | None, limit: int | None) -> tuple[System, list[ScoreRow]]:
    from b23d.stages.workbench.results.scores import run_parts, score_rows

    system = System(member.label, group_of(member), changes=_changes(member))
    try:
        run = Run.load(path, member.overrides, store)
        if "score_parts" in run.config.stages and "score" not in run.config.stages:
            system = replace(system, kind="parts")
        plan = run.plan(Selection(limit=limit))
    except UNUSABLE as error:
        return replace(system, reason=reason_of(error)), []
    try:
        if "score" in run.config.stages:
            rows = score_rows(run, Selection(limit=limit))
            return replace(system, seconds=seconds(run, plan), note=_note(run, plan)), rows
        return replace(system, parts=run_parts(run), seconds=seconds(run, plan), note=_note(run, plan)), []
    except ValueError as error:
        return replace(system, reason=unmade(run, plan) or _why_empty(run, error)), []


def _why_empty(run: Run, error: ValueError) -> str:
    """Not run yet, or nothing to run."""
    stage = "score" if "score" in run.config.stages else "score_parts"
    if stage not in run.config.stages:
        return reason_of(error)
    wanted = any(name == stage for name, _, _ in run.plan().by_shape)
    return "not run" if wanted else f"the data set has no annotation that {stage} could compare with"


def _scored(system: System, rows: dict[ScoreKey, ScoreRow], shared: set[ScoreKey]) -> System:
    from b23d.stages.scoring.summary import score_table

    common = sorted((key for key in rows if key in shared), key=str)
    if not common:
        return replace(system, reason="scored, but none of the targets that the others have scored", note="")
    lacks = f"only {len(common)} of {counted(len(shared), 'target')}" if len(common) < len(shared) else ""
    note = "; ".join(filter(None, [lacks, system.note]))
    return replace(system, scores=score_table(system.label, None, [rows[key] for key in common]), note=note)


def seconds(run: Run, plan: Plan) -> float | None:
    """Computing time per target: each stage's own per artifact, what serves a whole draw shared out among its targets;
    without scoring."""
    total, targets = 0.0, 0
    final = feeding(run.config.file, "transfer" if "score_parts" in run.config.stages else "optimize")
    lines = {line["stage"]: line for line in costs(run, plan)}
    targets = lines[final]["made"] if final in lines else 0
    for stage, line in lines.items():
        if stage in ("score", "score_parts") or not line["made"]:
            continue
        inputs = run.config.stages[stage].inputs
        trained = bool(inputs) and all(item.per_shot for item in inputs)
        total += line["seconds"] / (max(targets, 1) if trained else line["made"])
    return total if targets else None


def _note(run: Run, plan: Plan) -> str:
    failed = len({failure.shape for failure in failures(run, plan) if failure.stage not in ("draw", SHOTS)})
    return f"{counted(failed, 'shape')} failed" if failed else ""


def _changes(member: Member) -> dict[str, str]:
    """The member's own overrides, without those of the whole comparison, and without its name."""
    pairs = (text.partition("=")[::2] for text in member.own)
    return {field: value for field, value in pairs if field != "name"}


def _alike(reference: System, systems: list[System]) -> bool:
    """Whether a reference shows what the group shows: keypoints, or parts."""
    return any(system.kind == reference.kind for system in systems)


def _plain(system: System) -> dict[str, Any]:
    scores, parts = system.scores, system.parts
    return {
        "system": system.name, "group": system.group, "kind": system.kind, "changes": system.changes,
        "seconds": system.seconds,
        "reason": system.reason, "note": system.note, "scores": scores and scores.model_dump(mode="json"),
        "parts": parts and parts.model_dump(mode="json"),
    }  # fmt: skip
