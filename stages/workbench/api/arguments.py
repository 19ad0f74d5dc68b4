"""What the Python API is given, checked before anything is done: a wrong type is told by the argument's name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.runfile.checking import short


def path_of(name: str, value: Any, what: str) -> Path:
    """The path that is meant. Raises TypeError where it is none, ValueError where it is empty.

    what: which one is expected, in words.
    """
    if not isinstance(value, str | os.PathLike) or isinstance(fspath := os.fspath(value), bytes):
        raise TypeError(f"{name}: expected {what}, got {short(value)}; give its path, or one call for each of several")
    if not fspath:
        raise ValueError(f"{name}: expected {what}, got an empty text; give its path")
    return Path(fspath)


def store_of(value: Any) -> str | None:
    """A store's path or URL. Raises TypeError where it is neither, ValueError where it is empty."""
    if value is None or (isinstance(value, str) and "://" in value):
        return value
    return str(path_of("store", value, "a folder or a URL"))


def texts_of(name: str, value: Any, example: str) -> list[str]:
    """A list of texts. Raises TypeError where it is a text itself, or holds something else."""
    listed = list(value) if isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping) else None
    if listed is None or not all(isinstance(text, str) for text in listed):
        raise TypeError(f"{name}: expected a list of texts, got {short(value)}; for example {example}")
    return listed


def encoder_of(value: Any) -> str | None:
    """An encoder's name, or None. Raises TypeError where it is neither."""
    if value is not None and not isinstance(value, str):
        raise TypeError(f"encoder: expected a name, got {short(value)}; give one that the README lists")
    return value


def places_of(value: Any) -> np.ndarray:
    """(n, 3) float64 places. Raises ValueError where they are none, or not finite."""
    try:
        places = np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"points: expected numbers (n, 3), got {short(value)}; give an array of places") from error
    if places.ndim != 2 or places.shape[1] != 3:
        raise ValueError(f"points: expected places (n, 3), got an array of shape {places.shape}; give x y z of each")
    if not np.isfinite(places).all():
        wrong = places[~np.isfinite(places).all(axis=1)][0].tolist()
        raise ValueError(f"points: expected finite places, got {wrong}; leave such points out")
    return places


def workers_of(value: Any) -> int | None:
    """A number of worker processes, or None. Raises TypeError or ValueError where it is none."""
    if value is None:
        return None
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"workers: expected a whole number, got {short(value)}; 0 runs all in this process")
    if value < 0:
        raise ValueError(f"workers: expected 0 or more, got {value}; 0 runs all in this process")
    return value


ShotChoice = int | list[str] | dict[str, list[str]] | None
"""How many; ids of the only class; class → ids; as the run file says."""


def shots_of(value: Any) -> ShotChoice:
    """What `b23d.keypoints` takes for shots. Raises TypeError or ValueError where it is none of these."""
    example = '["bench", "stool"], or {"chairs": ["bench", "stool"]}'
    if value is None:
        return None
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"shots: expected 1 or more, got {value}; give how many annotated shapes are shown")
        return value
    if isinstance(value, bool | str | bytes) or not isinstance(value, Iterable):
        raise TypeError(f"shots: expected a number, ids or class → ids, got {short(value)}; for example 3, {example}")
    if isinstance(value, Mapping):
        found = {name: texts_of(f"shots[{name!r}]", ids, example) for name, ids in value.items()}
        if empty := [name for name, ids in found.items() if not ids or not isinstance(name, str)]:
            raise ValueError(f"shots: expected classes with ids, got {short({name: found[name] for name in empty})}")
        if found:
            return found
    elif listed := texts_of("shots", value, example):
        return listed
    raise ValueError(f"shots: expected ids, got none; for example {example}, or None for as many as there are, up to 3")
