"""Tables to checked params; errors say what was expected and, for a key that stands in the wrong place, where it
belongs."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.runfile.overrides import SHOWN, said
from b23d.schemas.params import Params, choice_of, flat, homes
from b23d.schemas.wanted import wanted

P = TypeVar("P", bound=Params)


@dataclass(frozen=True)
class Where:
    """A table of a run file, for messages; what an override has set is blamed on the override."""

    path: Path
    name: str
    """Dotted; "" for the file itself."""
    overrides: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"run file {self.path}" + (f": [{self.name}]" if self.name else "")

    def table(self, name: str) -> Where:
        """Another table of the file, by its whole dotted name."""
        return replace(self, name=name)

    def of(self, key: str) -> str:
        """Where a field of this table (or, without a name, any of them) was said: the last override that sets it, or
        the table it stands in; else the file."""
        dotted = ".".join(filter(None, (self.name, key)))
        for text in reversed(self.overrides):
            set_, _, _ = (part.strip() for part in text.partition("="))
            if f"{dotted}.".startswith(f"{set_}.") or set_.startswith(f"{dotted}."):
                return said(text)
        return str(self)


def validate(
    model: type[P], table: Mapping[str, Any], where: Where, above: Mapping[str, type[Params]] | None = None
) -> P:
    """Raises RunFileError with a line for everything that is wrong; what said it (`where`) begins each.

    above: tables in which a key may belong that this one has not, by their dotted names.
    """
    try:
        return model.model_validate(table)
    except ValidationError as error:
        raise RunFileError(
            "\n".join(_line(model, problem, where, above or {}) for problem in error.errors())
        ) from error


def _line(model: type[BaseModel], problem: Any, place: Where, above: Mapping[str, type[Params]]) -> str:
    key = ".".join(map(str, problem["loc"]))
    where = place.of(key)
    table = _table_at(model, problem["loc"][:-1])
    if problem["type"] == "extra_forbidden":
        name = str(problem["loc"][-1])
        elsewhere = _belongs(table, name, place.name) if table else None
        if not place.name and len(problem["loc"]) == 1:
            elsewhere = elsewhere or _of_stages(name, problem["input"], table, above)
        elif place.name and above:
            given = problem["input"] if isinstance(problem["input"], dict) else {}
            tables = {place.name: model, **above}
            elsewhere = elsewhere or next(filter(None, (_lives(str(one), tables) for one in (name, *given))), None)
        elsewhere = elsewhere or suggest(name, table.model_fields if table else ())
        return f"{where}: expected a known key, got {key!r}; {elsewhere}"
    if problem["type"] == "missing":
        return f"{where}: expected {key!r}, got nothing; add it"
    if problem["type"] == "model_type" and (inner := _table_at(model, problem["loc"])):
        fields = ", ".join(inner.model_fields)
        return (
            f"{where}: {key}: expected a table, got {short(problem['input'])}; it takes {fields}: "
            f"set {key}.{next(iter(inner.model_fields))}, say"
        )
    if problem["type"] == "value_error" and "; " in (own := str(problem["ctx"]["error"])):  # says it all itself
        return f"{where}: {own}"
    return f"{where}: {key}: expected {wanted(problem)}, got {short(problem['input'])}; mend the value"


def short(value: Any) -> str:
    """A value as a message shows it."""
    try:
        text = repr(str(value) if isinstance(value, str) else value)
    except (RecursionError, ValueError):  # ValueError: a whole number of more digits than Python prints
        return f"a {type(value).__name__} too deep or long to print"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}…"


def _belongs(model: type[BaseModel], name: str, stage: str) -> str | None:
    """Where a key that is none of the model's own belongs; None where no table of it has one of that name."""
    if not (found := homes(model, name)):
        return None
    choices = [choice_of(model, home[0]) for home in found]
    of = f"{choices[0][0]} " if choices[0] else ""
    owners = ", ".join(
        dict.fromkeys(str(choice[1]) if choice else home[0] for choice, home in zip(choices, found, strict=True))
    )
    return f"{name} belongs to {of}{owners}: set {'.'.join(filter(None, (stage, *found[0])))}"


def _lives(name: str, tables: Mapping[str, type[BaseModel]]) -> str | None:
    """Where a key belongs that no table inside its own has: the first of these that has it, at the top or deeper."""
    for where, table in tables.items():
        if found := [(name,)] * (name in table.model_fields) or homes(table, name):
            return f"{name} belongs to {where}: set {where}.{'.'.join(found[0])}"
    return None


def _of_stages(
    name: str, given: Any, file: type[BaseModel] | None, stages: Mapping[str, type[BaseModel]]
) -> str | None:
    """Where a key belongs that the file has no table for: a stage, or a field of one, said without `stages.`; None
    where it is like a table of the file, or like nothing."""
    near = difflib.get_close_matches(name, file.model_fields if file else (), 1)
    stage = difflib.get_close_matches(f"stages.{name}", [] if near else stages, 1, 0.8)
    if f"stages.{name}" in stages or stage:
        inner = next((f".{key}" for key in flat(given)), "") if isinstance(given, dict) else ""
        return f"did you mean '{f'stages.{name}' if f'stages.{name}' in stages else stage[0]}{inner}'?"
    return None if near else _lives(name, stages)


def _table_at(model: type[BaseModel], location: Iterable[Any]) -> type[BaseModel] | None:
    for key in location:
        field = model.model_fields.get(str(key))
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return None
        model = field.annotation
    return model


def suggest(name: str, known: Iterable[str]) -> str:
    """The end of an error about a name that is not known."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, 1)
    return f"did you mean {close[0]!r}?" if close else f"it takes {', '.join(known) or 'none here'}"
