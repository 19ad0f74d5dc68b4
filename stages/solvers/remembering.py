"""What shots teach is learned once in a process, not once a target: all targets of a draw are given the same shots.

Only speed depends on it. What was made is taken again only for the same artifacts (the same objects, whose arrays
nobody can write to, as those that a store gives), the same keypoints and the same parameters; it is dropped with the
artifacts that it was made of.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from typing import Any, TypeVar

from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params
from b23d.stages.solvers.shots import Shot

_Options = TypeVar("_Options", bound=Params)
_Made = TypeVar("_Made")
KEEP = 64
"""Results at hand, of the last draws used; each is a model of some keypoints, well below 1 MB."""

_kept: OrderedDict[Hashable, tuple[list[weakref.ref[Artifact]], Any]] = OrderedDict()


def once(make: Callable[[Sequence[Shot], _Options], _Made], shots: Sequence[Shot], options: _Options) -> _Made:
    """`make(shots, options)`, or what it gave for them before. It must depend on nothing else, and what it gives must
    not be changed."""
    artifacts: list[Artifact] = []
    for shot in shots:
        artifacts += [shot.shape, shot.features, shot.distances]
    if not all(_unchangeable(shot) for shot in shots):
        return make(shots, options)
    key = (
        make,
        type(options),
        options.model_dump_json(),
        tuple(map(id, artifacts)),
        tuple((shot.index, shot.keypoints.ids.tobytes(), shot.at.tobytes()) for shot in shots),
    )
    of, made = _kept.pop(key, ([], None))
    if not of or any(ref() is not artifact for ref, artifact in zip(of, artifacts, strict=True)):  # an id is used anew
        of, made = [weakref.ref(artifact) for artifact in artifacts], make(shots, options)
    _kept[key] = of, made
    while len(_kept) > KEEP:
        _kept.popitem(last=False)
    result: _Made = made
    return result


def _unchangeable(shot: Shot) -> bool:
    arrays = shot.shape.points, shot.features.features, shot.features.observed, shot.distances.distances
    return not any(array.flags.writeable for array in arrays)
