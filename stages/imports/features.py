"""Point features as other systems write them.

generic (ours): .npz with `features` (n, c), optionally `points` (n, 3) where they are; .npy, .txt or .csv of (n, c),
one row a candidate. d3feat: .npz with `features` (n, 32) and `keypts` (n, 3), as D3Feat's `demo_registration.py` writes
(XuyangBai/D3Feat).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from b23d.schemas.external import External
from b23d.schemas.wording import counted
from b23d.stages.imports.arrays import arrays, shaped

Read = tuple[np.ndarray, np.ndarray | None]
"""Features (n, c), and points (n, 3) in the file's frame, if it has them."""


def generic(file: External) -> Read:
    return _read(file, arrays(file), "points")


def d3feat(file: External) -> Read:
    found = arrays(file)
    if "keypts" not in found:
        raise ValueError(
            f"{file.shape}: expected keypts and features, got {', '.join(found)}; give the .npz that D3Feat writes"
        )
    return _read(file, found, "keypts")


READERS: Mapping[str, Callable[[External], Read]] = {"generic": generic, "d3feat": d3feat}


def _read(file: External, found: Mapping[str, np.ndarray], where: str) -> Read:
    features = found.get("features", found.get(""))
    if features is None or features.ndim != 2 or not features.size or features.dtype.kind not in "iuf":
        got = "none" if features is None else f"{features.dtype} {features.shape}"
        raise ValueError(f"{file.shape}: expected features of (n, channels) numbers, got {got}; write it again")
    points = shaped(file, where, found[where], 3) if where in found else None
    if points is not None and len(points) != len(features):
        raise ValueError(
            f"{file.shape}: expected {where} of {counted(len(features), 'feature')}, got {len(points)}; write it again"
        )
    return features, points
