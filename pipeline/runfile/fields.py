"""Every field that a run file can set: its dotted name, what it takes, its default, when it counts, what it means."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from b23d.pipeline.dataset import DATASETS
from b23d.pipeline.stage import load_stages
from b23d.schemas.params import Params, Unhashed, When
from b23d.schemas.runfile import RunFile

LIMITS = {
    "ge": "≥ {}",
    "gt": "> {}",
    "le": "≤ {}",
    "lt": "< {}",
    "min_length": "at least {} long",
    "pattern": "like {}",
}


@dataclass(frozen=True)
class SettableField:
    """One field."""

    name: str
    """As `--set` takes it: `stages.optimize.discrete.alpha`."""
    takes: str
    """Its type and limits, in words."""
    default: str
    """"" where it must be given."""
    used: str
    """Which choices of other fields it counts under; "" always."""
    address: bool
    """Whether it enters the address of what is made."""
    means: str

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def tables() -> dict[str, type[Params]]:
    """Dotted name → model of every table: the run file's own, each kind of data set's, each stage's."""
    found: dict[str, type[Params]] = {}
    for name, field in RunFile.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, Params):
            found[name] = field.annotation
    found |= {f"dataset ({kind})": declared for kind, declared in sorted(DATASETS.items())}
    return found | {f"stages.{name}": stage.params for name, stage in load_stages().items()}


def fields_of(model: type[Params], prefix: str, used: str = "") -> Iterator[SettableField]:
    """The fields of a table and of the tables in it, in order."""
    for name, field in model.model_fields.items():
        inner = field.annotation
        when = " and ".join(filter(None, [used, _when(field, prefix)]))
        if isinstance(inner, type) and issubclass(inner, Params):
            yield from fields_of(inner, f"{prefix}.{name}", when)
            continue
        default = field.get_default(call_default_factory=True)
        yield SettableField(
            name=f"{prefix}.{name}",
            takes=", ".join([_type(inner), *_limits(field)]),
            default="" if default is PydanticUndefined else _value(default),
            used=when,
            address=not any(isinstance(mark, Unhashed) for mark in field.metadata),
            means=" ".join((field.description or "").split()),
        )


def _when(field: FieldInfo, prefix: str) -> str:
    """`method = "discrete"`, or several joined by "or"."""
    whens = [mark for mark in field.metadata if isinstance(mark, When)]
    return " or ".join(
        " and ".join(f"{key} = {' | '.join(map(_value, values))}" for key, values in when.choices.items())
        for when in whens
    )


def _type(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation is type(None):
        return "none"
    if origin is Literal:
        return " | ".join(map(_value, arguments))
    if origin in (Union, UnionType):
        return " | ".join(map(_type, arguments))
    if origin is not None and not isinstance(origin, type):  # Annotated and its kin
        return _type(arguments[0])
    if origin in (list, tuple, set):
        return f"list of {_type(arguments[0])}" if arguments else "list"
    if origin is dict:
        return f"table of {_type(arguments[1])}"
    names = {str: "text", int: "whole number", float: "number", bool: "true | false", Path: "path", Any: "anything"}
    return names.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _limits(field: FieldInfo) -> list[str]:
    return [
        words.format(getattr(mark, key))
        for mark in field.metadata
        for key, words in LIMITS.items()
        if getattr(mark, key, None) is not None
    ]


def _value(value: Any) -> str:
    """As TOML would have it."""
    if value is None:
        return "none"
    if isinstance(value, Path):
        return str(value)
    return json.dumps(value, ensure_ascii=False, default=str)
