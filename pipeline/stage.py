"""Stages as plain, annotated functions. This is all of the engine that a stage may know.

>>> @stage(version=1)
... def geodesic(normalize: NormalizedShape, params: GeodesicParams) -> GeodesicDistances: ...

The signature is the wiring. An argument's name is the upstream stage (or a leaf of the data set: `source`, `keypoints`,
`parts`), its annotation the schema it must have. `shot_<upstream>: list[Schema]` asks for that artifact of every shot
of the target's draw, in the same order for all `shot_` arguments. `example_<upstream>: list[Schema]` asks for it of the
class's examples: the shots of its first draw, the same for every shape and every draw, so that what is made of them is
made once. `X | None` accepts a leaf, or what a stage makes, that a shape does not have; without it, the stage is not
planned for such a shape. `checks="<leaf>"` makes a stage the gate of a leaf: a shape that
fails it is no shot and gives the leaf to nobody, and loses nothing else. A field `warnings: list[str]` of what a stage
gives is told at the end of a run.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from b23d.pipeline.errors import MissingPackageError
from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params

Function = TypeVar("Function", bound=Callable[..., Artifact])
SHOT, EXAMPLE = "shot_", "example_"


@dataclass(frozen=True)
class Input:
    """One argument of a stage: which upstream artifact it wants."""

    name: str
    upstream: str
    schema: type[Artifact]
    per_shot: bool = False
    example: bool = False
    optional: bool = False


@dataclass(frozen=True)
class Hints:
    """What a task would like to have. Never hashed."""

    gpu: Literal["no", "useful", "required"] = "no"
    memory_gb: float = 1.0


@dataclass(frozen=True)
class Stage:
    name: str
    version: int
    function: Callable[..., Artifact]
    params: type[Params]
    gives: type[Artifact]
    inputs: tuple[Input, ...]
    hints: Hints = field(default_factory=Hints)
    fingerprint: Callable[[Any], Mapping[str, str]] | None = None
    """Digests of what the params only name (encoder weights); they enter the address."""
    checks: str | None = None
    """A leaf that this stage looks at, so that others need not: whoever takes the leaf, of a shape or of shots, waits
    for this stage's success, which enters no address."""


STAGES: dict[str, Stage] = {}


def stage(
    *,
    version: int,
    hints: Hints | None = None,
    fingerprint: Callable[[Any], Mapping[str, str]] | None = None,
    checks: str | None = None,
) -> Callable[[Function], Function]:
    """Declare a function as a stage. The function itself is returned unchanged: tests call it with arrays.

    Raises TypeError at import where the signature is not a stage's.
    """

    def declare(function: Function) -> Function:
        name = function.__name__
        if name in STAGES and STAGES[name].function.__module__ != function.__module__:
            raise TypeError(
                f"stage {name}: expected one declaration, got a second in {function.__module__}; rename one"
            )
        hints_of = get_type_hints(function)
        gives = hints_of.pop("return", None)
        params = hints_of.pop("params", None)
        if not (inspect.isclass(gives) and issubclass(gives, Artifact)):
            raise TypeError(f"stage {name}: expected a return annotation that is an Artifact, got {gives}; annotate it")
        if not (inspect.isclass(params) and issubclass(params, Params)):
            raise TypeError(
                f"stage {name}: expected an argument `params` annotated with a Params, got {params}; add one"
            )
        inputs = tuple(_input(name, argument, annotation) for argument, annotation in hints_of.items())
        STAGES[name] = Stage(name, version, function, params, gives, inputs, hints or Hints(), fingerprint, checks)
        return function

    return declare


def upstream_of(argument: str) -> str:
    """What an argument of this name asks for."""
    return argument.removeprefix(SHOT).removeprefix(EXAMPLE)


def load_stages() -> dict[str, Stage]:
    """Every installed stage: import what the entry-point group `b23d.stages` names. The engine names none itself.

    Raises MissingPackageError where the group is empty.
    """
    for plugin in _declared("b23d.stages"):
        plugin.load()
    return STAGES


@cache
def load_stages_once() -> dict[str, Stage]:
    """As `load_stages`, which asks the installed packages each time: a worker does so once."""
    return load_stages()


def default_outputs() -> list[str]:
    """What a run wants that does not say: the lists of stages that the entry-point group `b23d.outputs` names.

    Raises MissingPackageError where the group is empty: a run of nothing would end well.
    """
    return [name for plugin in _declared("b23d.outputs") for name in plugin.load()]


def _declared(group: str) -> EntryPoints:
    """What the installed packages declare. An editable install keeps the groups of the day it was made."""
    found = entry_points(group=group)
    if not found:
        raise MissingPackageError(
            f"entry points {group}: expected those that b23d declares, got none; the installation is older than the "
            "code: install it again (`pip install -e .` where it is a checkout)"
        )
    return found


def _input(stage_name: str, argument: str, annotation: Any) -> Input:
    per_shot, example = argument.startswith(SHOT), argument.startswith(EXAMPLE)
    optional = get_origin(annotation) in (Union, UnionType) and type(None) in get_args(annotation)
    if ((per_shot or example) and get_origin(annotation) is list) or optional:
        annotation = next(a for a in get_args(annotation) if a is not type(None))
    if not (inspect.isclass(annotation) and issubclass(annotation, Artifact)):
        wanted = "list[Artifact]" if per_shot or example else "an Artifact"
        raise TypeError(
            f"stage {stage_name}: expected {argument} annotated with {wanted}, got {annotation}; annotate it"
        )
    return Input(argument, upstream_of(argument), annotation, per_shot, example, optional)
