"""Keypoints as other systems write them. Frames: the data set's own unless the stage's `frame` says otherwise.

| format | file | whose |
|---|---|---|
| generic | .npz with `points` (k, 3) or `indices` (k,) into the data set's cloud; optional `ids` (k,), `scores` (k,); .npy of either; .txt or .csv of rows `x y z [score [id]]` | ours |
| usip | .bin: float32 little-endian, x y z of each keypoint, no header, surest first | as USIP's `evaluation/save_keypoints.py` writes (lijx10/USIP) |
| d3feat | .npz with `keypts` (n, 3), `scores` (n, 1) and `features`, all points of the voxel-thinned cloud, worst first | as D3Feat's `demo_registration.py` writes (XuyangBai/D3Feat) |
| ukpgan | .npy, or .npz with `prob`: probability (n,) of every point of the data set's cloud, in its order | our reading: `eval_iou.py` (qq456cvb/UKPGAN) keeps this `encoder/z` in memory only; its NMS (.1) and threshold (.5) are the defaults |
| fskd | .npz with `indices` (k,) or `points` (k, 3), and `ids` (k,) | our reading: no code of FSKD (Attaiki and Ovsjanikov 2022) that writes keypoints was found |
| sift3d-csv | .csv of rows `x y z o s` and the orientation's 9 entries, or these after the strength; times 2**o they are voxels | as SIFT3D's `kpSift3D --keys` writes (bbrister/SIFT3D; the strength first, in later versions of a fork); SIFT3D works on volumes, so that `spacing` and `origin` must say how the shape was voxelised |
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from b23d.schemas.external import External
from b23d.schemas.wording import counted
from b23d.stages.imports.arrays import arrays, shaped, whole

SIFT3D_COLUMNS = 14


@dataclass(frozen=True)
class ExternalKeypoints:
    """What a file says: points (k, 3) in the file's frame, and where it has them, indices, ids and scores (k,); higher
    is better."""

    points: np.ndarray
    indices: np.ndarray | None = None
    ids: np.ndarray | None = None
    scores: np.ndarray | None = None


def choose(
    found: ExternalKeypoints, least: float | None, radius: float | None, most: int | None
) -> npt.NDArray[np.int64]:
    """The rows that stay, best first: score above `least`, no better one within `radius`, at most `most` of them.

    The suppression is greedy, as USIP's and UKPGAN's: a suppressed point suppresses none.
    """
    scores = (
        -np.arange(len(found.points), dtype=np.float64) if found.scores is None else found.scores.astype(np.float64)
    )
    order = np.argsort(-scores, kind="stable")
    if least is not None:
        order = order[scores[order] > least]
    if radius:
        left, kept = order, []
        while len(left):
            kept.append(left[0])
            left = left[np.linalg.norm(found.points[left] - found.points[left[0]], axis=1) > radius]
        order = np.array(kept, np.int64)
    return order[:most].astype(np.int64)


def generic(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    """See the table above; `cloud` (n, 3) is where the candidates are in the source frame, for indices."""
    found = arrays(file)
    table = found.pop("", None)
    if table is not None and file.suffix == ".npy":
        found = {"indices" if table.ndim == 1 else "points": table}
    elif table is not None:
        table = np.empty((0, 3)) if not table.size else table
        if table.ndim != 2 or not 3 <= table.shape[1] <= 5:
            raise ValueError(f"{file.shape}: expected rows of x y z [score [id]], got {table.shape}; write it again")
        found = dict(zip(("points", "scores", "ids"), (table[:, :3], *table.T[3:]), strict=False))
    if unknown := found.keys() - {"points", "indices", "ids", "scores"}:
        raise ValueError(
            f"{file.shape}: expected points or indices, ids and scores, got {', '.join(sorted(unknown))}; "
            "set another format"
        )
    return _found(file, cloud, found)


def usip(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    if file.suffix != ".bin" or len(file.data) % 12:
        raise ValueError(
            f"{file.shape}: expected a .bin of 12 bytes a keypoint, got {file.suffix} of {len(file.data)}; "
            "write it again"
        )
    return ExternalKeypoints(np.frombuffer(file.data, "<f4").reshape(-1, 3))


def d3feat(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    found = arrays(file)
    if not {"keypts", "scores"} <= found.keys():
        raise ValueError(
            f"{file.shape}: expected keypts and scores, got {', '.join(found) or 'none'}; "
            "give the .npz that D3Feat writes"
        )
    return _found(file, cloud, {"points": found["keypts"], "scores": found["scores"]})


def ukpgan(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    found = arrays(file)
    scores = found.get("prob", found.get(""))
    if scores is None:
        raise ValueError(
            f"{file.shape}: expected prob, got {', '.join(found)}; store each point's probability as prob, or as .npy"
        )
    scores = shaped(file, "prob", scores, None)
    if len(scores) != len(cloud):
        raise ValueError(
            f"{file.shape}: expected a probability of each of {counted(len(cloud), 'candidate')}, got {len(scores)}; "
            "use the same cloud"
        )
    return _found(file, cloud, {"indices": np.arange(len(cloud)), "scores": scores})


def fskd(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    found = arrays(file)
    if "ids" not in found:
        raise ValueError(f"{file.shape}: expected ids, got {', '.join(found)}; FSKD's keypoints have names")
    return generic(file, cloud, params)


def sift3d_csv(file: External, cloud: np.ndarray, params: Any) -> ExternalKeypoints:
    table = arrays(file).get("")
    if table is None or (
        table.size and (table.ndim != 2 or table.shape[1] not in (SIFT3D_COLUMNS, SIFT3D_COLUMNS + 1))
    ):
        raise ValueError(
            f"{file.shape}: expected rows of 14 numbers (15 with the strength), got others; "
            "give what kpSift3D --keys writes"
        )
    table = table if table.size else np.empty((0, SIFT3D_COLUMNS))
    rows = table[:, -SIFT3D_COLUMNS:]
    points = np.asarray(params.sift3d_csv.origin) + params.sift3d_csv.spacing * rows[:, :3] * 2.0 ** rows[:, 3:4]
    return ExternalKeypoints(points, scores=table[:, 0] if table.shape[1] > SIFT3D_COLUMNS else None)


READERS: Mapping[str, Callable[[External, np.ndarray, Any], ExternalKeypoints]] = {
    "generic": generic, "usip": usip, "d3feat": d3feat, "ukpgan": ukpgan, "fskd": fskd, "sift3d-csv": sift3d_csv,
}  # fmt: skip


def _found(file: External, cloud: np.ndarray, values: Mapping[str, np.ndarray]) -> ExternalKeypoints:
    if ("points" in values) == ("indices" in values):
        raise ValueError(
            f"{file.shape}: expected either points or indices, got {', '.join(values) or 'none'}; write it again"
        )
    ids = whole(file, "ids", values["ids"]) if "ids" in values else None
    scores = shaped(file, "scores", values["scores"], None) if "scores" in values else None
    indices = whole(file, "indices", values["indices"]) if "indices" in values else None
    # Indices beyond the cloud are refused later, with the shape at hand.
    points = (
        shaped(file, "points", values["points"], 3) if indices is None else cloud[np.clip(indices, 0, len(cloud) - 1)]
    )
    for what, array in (("ids", ids), ("scores", scores)):
        if array is not None and len(array) != len(points):
            raise ValueError(
                f"{file.shape}: expected {what} of {counted(len(points), 'keypoint')}, got {len(array)}; write it again"
            )
    if scores is not None and np.isnan(scores).any():
        raise ValueError(f"{file.shape}: expected scores, got NaN; write it again")
    return ExternalKeypoints(points, indices, ids, scores)
