"""Artifact: base of every schema a stage takes or gives. The schema is the on-disk format.

Array fields are annotated with an `ArraySpec`; all others are plain JSON values:

>>> class Cloud(Artifact):
...     points: Annotated[np.ndarray, ArraySpec("n 3", "float32", unit="unit box")]
...     colors: Annotated[np.ndarray, ArraySpec("n 3", "uint8")] | None = None
...     name: str
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Self, cast, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, PrivateAttr, create_model, model_validator


@dataclass(frozen=True)
class ArraySpec:
    """Shape, dtype and unit of an array field.

    `dims` names the axes ("n 3": any n, then 3); a name stands for one length throughout the artifact.
    `sharded`: stored as one chunk per index of the first axis, all in one shard, so that one view can be read alone.
    """

    dims: str
    dtype: str
    unit: str = ""
    sharded: bool = False

    def __str__(self) -> str:
        return f"{self.dtype} ({', '.join(self.dims.split())})"


class Artifact(BaseModel):
    """A validated, immutable value that a stage takes or gives.

    Raises (at construction): ValueError where an array's dtype or shape breaks its `ArraySpec`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True, use_attribute_docstrings=True)

    _read: Callable[[str], np.ndarray] | None = PrivateAttr(None)

    @classmethod
    @cache
    def array_specs(cls) -> dict[str, ArraySpec]:
        """The array fields of this schema, by name."""
        return {name: spec for name, field in cls.model_fields.items() if (spec := _spec_of(field)) is not None}

    @classmethod
    def lazy(cls, values: dict[str, Any], arrays: set[str], read: Callable[[str], np.ndarray]) -> Self:
        """An artifact whose `arrays` are read with `read(name)` when first touched; `values` are its JSON fields."""
        artifact = cls.model_construct(**cls._plain_model().model_validate(values).__dict__)
        for name in arrays:
            artifact.__dict__.pop(name, None)
        artifact._read = read
        return cast(Self, artifact)

    def locked(self) -> Self:
        """Itself, its arrays read-only from now on: for one that many share."""
        for name in self.array_specs():
            if isinstance(value := self.__dict__.get(name), np.ndarray):
                value.flags.writeable = False
        if (read := self._read) is not None:
            self._read = lambda name: _read_only(read(name))
        return self

    @classmethod
    @cache
    def _plain_model(cls) -> type[BaseModel]:
        """The fields that are not arrays, as a model: JSON's lists become the tuples, its texts the keys, that they
        were."""
        fields: dict[str, Any] = {
            name: (field.annotation, field) for name, field in cls.model_fields.items() if name not in cls.array_specs()
        }
        return create_model(f"{cls.__name__}Fields", **fields)

    def present_arrays(self) -> dict[str, np.ndarray]:
        """Every array that is present, read if need be."""
        return {name: value for name in self.array_specs() if (value := getattr(self, name)) is not None}

    def plain_fields(self) -> dict[str, Any]:
        """Every field that is not an array, as JSON values."""
        return self.model_dump(mode="json", exclude=set(self.array_specs()))

    @model_validator(mode="after")
    def _check_arrays(self) -> Self:
        lengths: dict[str, int] = {}
        for name, spec in self.array_specs().items():
            value = getattr(self, name)
            if value is not None:
                _check(f"{type(self).__name__}.{name}", value, spec, lengths)
        return self

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("_") and name in type(self).array_specs() and self._read is not None:
            value = self._read(name)
            _check(f"{type(self).__name__}.{name}", value, type(self).array_specs()[name], {})
            self.__dict__[name] = value
            return value
        return super().__getattr__(name)  # type: ignore[misc]


def _spec_of(field: Any) -> ArraySpec | None:
    candidates = [*field.metadata, *(m for arg in get_args(field.annotation) for m in getattr(arg, "__metadata__", ()))]
    return next((m for m in candidates if isinstance(m, ArraySpec)), None)


def _check(name: str, value: np.ndarray, spec: ArraySpec, lengths: dict[str, int]) -> None:
    dims = spec.dims.split()
    if value.dtype != np.dtype(spec.dtype) or value.ndim != len(dims):
        raise ValueError(f"{name}: expected {spec}, got {value.dtype} {value.shape}; convert it before you give it on")
    for dim, length in zip(dims, value.shape, strict=True):
        wanted = int(dim) if dim.isdigit() else lengths.setdefault(dim, length)
        if length != wanted:
            raise ValueError(
                f"{name}: expected {spec} with {dim} = {wanted}, got shape {value.shape}; "
                "arrays of one artifact must agree"
            )


def _read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array
