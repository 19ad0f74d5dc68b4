"""A table of keypoints as a file: csv, json, parquet, or a PLY of coloured points for one shape."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from b23d.stages.workbench.pictures.palette import id_color, rgb
from b23d.stages.workbench.pictures.solids import SceneObject, write_ply

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".json", ".parquet", ".ply")


def check_suffix(path: Path) -> None:
    """Raise ValueError where no table can be written to a file of this name."""
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"-o {path}: expected a file of {', '.join(SUFFIXES)}, got {path.suffix or 'no suffix'!r}; change its name"
        )


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write the table, and the folder for it. json: a list of objects.

    Raises ValueError for another suffix, or for a PLY of several shapes.
    """
    check_suffix(path)
    suffix = path.suffix.lower()
    if suffix == ".ply":
        shapes = table[["class", "shape"]].drop_duplicates()
        if len(shapes) > 1:
            raise ValueError(f"-o {path}: expected one shape for a PLY, got {len(shapes)}; choose it with --shape")
    path.parent.mkdir(parents=True, exist_ok=True)
    if suffix == ".csv":
        table.to_csv(path, index=False)
    elif suffix == ".json":
        table.to_json(path, orient="records", indent=1, double_precision=15)
    elif suffix == ".parquet":
        table.to_parquet(path, index=False)
    else:
        write_ply(_points(table), path, [_title(table)])


def _points(table: pd.DataFrame) -> SceneObject:
    """A coloured vertex a keypoint."""
    ids = table["id"].to_numpy(np.int64)
    colors = np.array([rgb(id_color(int(number))) for number in ids], np.uint8).reshape(-1, 3)
    scalars = {
        "id": ids.astype(np.float32),
        "present": table["present"].to_numpy(np.float32),
        **{name: table[name].to_numpy(np.float32, na_value=np.nan) for name in ("confidence", "of_class")},
    }
    return SceneObject("keypoints", table[["x", "y", "z"]].to_numpy(np.float64), colors, scalars=scalars)


def _title(table: pd.DataFrame) -> str:
    name = "/".join(table.iloc[0][["class", "shape"]]) if len(table) else "no shape"
    return f"keypoints of {name} in the coordinates of its own file"
