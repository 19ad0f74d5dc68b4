"""Params: what a user may set on a stage or a data set. Closed, frozen, printed in full; what counts is hashed.

An option that belongs to one choice of another field says so:

>>> class OptimizeParams(Params):
...     method: Literal["discrete", "nearest"] = "discrete"
...     discrete: Annotated[DiscreteParams, When(method="discrete")] = DiscreteParams()

Only what counts enters an address: under `method = "nearest"` the table `discrete` does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict
from pydantic.fields import FieldInfo


class Unhashed:
    """Marks a field that says where something is, not what it is: it never enters an address.

    >>> weights: Annotated[Path | None, Unhashed()] = None
    """


class When:
    """Marks a field that counts only where fields beside it have these values (a tuple: one of them). Of several marks
    on a field, one that holds is enough.

    >>> source_sigma: Annotated[float, When(source_features="keypoints")] = 0.01
    """

    def __init__(self, **choices: Any) -> None:
        self.choices = {key: value if isinstance(value, tuple) else (value,) for key, value in choices.items()}


class Params(BaseModel):
    """Base of every stage's and data set's parameters, and of the tables inside them.

    Unknown keys, NaN and infinities are errors; instances are immutable. All fields, defaults included, enter the
    address of what the stage makes, except those marked `Unhashed` and those whose `When` does not hold.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Raises TypeError at import where a `When` names what no field can be."""
        super().__pydantic_init_subclass__(**kwargs)
        for name, field in cls.model_fields.items():
            for key, values in (item for when in _whens(field) for item in when.choices.items()):
                chosen = cls.model_fields.get(key)
                if chosen is None:
                    raise TypeError(f"{cls.__name__}.{name}: expected When to name a field, got {key!r}; mend it")
                possible = get_args(chosen.annotation) if get_origin(chosen.annotation) is Literal else values
                if wrong := set(values) - set(possible):
                    raise TypeError(f"{cls.__name__}.{name}: expected {key} of {possible}, got {wrong}; mend When")

    def counts(self, name: str) -> bool:
        """Whether a field changes anything as the others are."""
        return self.missing(name) is None

    def missing(self, name: str) -> tuple[str, Any, Any] | None:
        """What keeps a field from counting: the field that chooses, the value it has, and one it would have to have.
        None where it counts."""
        found: tuple[str, Any, Any] | None = None
        for when in _whens(type(self).model_fields[name]):
            unmet = next((unmet for key in when.choices if (unmet := self._unmet(key, when.choices[key]))), None)
            if unmet is None:
                return None
            found = found or unmet
        return found

    def _unmet(self, key: str, values: tuple[Any, ...]) -> tuple[str, Any, Any] | None:
        value = getattr(self, key)
        return self.missing(key) or (None if value in values else (key, value, values[0]))

    def hashed(self) -> dict[str, Any]:
        """The fields that enter an address, as JSON values; tables as dictionaries."""
        dumped, kept = self.model_dump(mode="json"), {}
        for name, field in type(self).model_fields.items():
            if self.counts(name) and not any(isinstance(mark, Unhashed) for mark in field.metadata):
                value = getattr(self, name)
                kept[name] = value.hashed() if isinstance(value, Params) else dumped[name]
        return kept

    def options(self) -> Iterator[Option]:
        """Every field, those of tables by their dotted names, in order; a table counts no more than its field does."""
        for name, field in type(self).model_fields.items():
            value, counts = getattr(self, name), self.counts(name)
            if not isinstance(value, Params):
                yield Option(name, value, field, counts)
                continue
            for option in value.options():
                yield Option(f"{name}.{option.name}", option.value, option.field, counts and option.counts)


class Option:
    """A field that is no table."""

    def __init__(self, name: str, value: Any, field: FieldInfo, counts: bool) -> None:
        self.name, self.value, self.field, self.counts = name, value, field, counts

    @property
    def unhashed(self) -> bool:
        return any(isinstance(mark, Unhashed) for mark in self.field.metadata)


def flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted name → value of nested tables, as `--set` takes them."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def missing_choice(params: Params, keys: Sequence[str], prefix: str = "") -> tuple[str, Any, Any] | None:
    """What keeps the field at `keys` from counting: the dotted name of the field that chooses, the value it has, and
    one it would have to have. None where the field counts."""
    name = keys[0]
    if found := params.missing(name):
        return f"{prefix}{found[0]}", *found[1:]
    table = getattr(params, name)
    return missing_choice(table, keys[1:], f"{prefix}{name}.") if isinstance(table, Params) and keys[1:] else None


def tables_of(model: type[BaseModel]) -> dict[str, type[Params]]:
    """The fields of a model that are tables themselves."""
    return {
        name: field.annotation
        for name, field in model.model_fields.items()
        if isinstance(field.annotation, type) and issubclass(field.annotation, Params)
    }


def homes(model: type[BaseModel], name: str) -> list[tuple[str, ...]]:
    """Where a field of this name (or `<table>_<name>`) stands in the tables of a model, the least deep first."""
    found: list[tuple[str, ...]] = []
    for key, table in tables_of(model).items():
        for inner in dict.fromkeys((name, name.removeprefix(f"{key}_"))):
            found += [(key, inner)] if inner in table.model_fields else []
            found += [(key, *deeper) for deeper in homes(table, inner)]
    return sorted(found, key=len)


def choice_of(model: type[BaseModel], name: str) -> tuple[str, Any] | None:
    """The field, and a value of it, that a field's first `When` asks for."""
    for when in _whens(model.model_fields[name]):
        return next((key, values[0]) for key, values in when.choices.items())
    return None


def _whens(field: FieldInfo) -> list[When]:
    return [mark for mark in field.metadata if isinstance(mark, When)]
