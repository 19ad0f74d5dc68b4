"""Arrays from the bytes of .npz, .npy, text and raw files; nothing in them is ever executed (no pickles)."""

from __future__ import annotations

import io
import zipfile

import numpy as np

from b23d.schemas.external import External


def arrays(file: External) -> dict[str, np.ndarray]:
    """The arrays of a .npz by name; the one of a .npy, or the table of a .txt or .csv (spaces or commas), under "".

    Raises ValueError, naming the shape, where the file is none of these, is damaged, or holds pickled objects.
    """
    try:
        if file.suffix in (".npz", ".npy"):
            loaded = np.load(io.BytesIO(file.data), allow_pickle=False)
            return {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
        if file.suffix in (".txt", ".csv"):
            rows = [line.replace(",", " ").split() for line in file.data.decode().splitlines()]
            return {"": np.array([row for row in rows if row and not row[0].startswith("#")], np.float64)}
    except (ValueError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"{file.shape}: expected a {file.suffix} file of numbers, got {error}; write it again"
        ) from error
    raise ValueError(f"{file.shape}: expected .npz, .npy, .txt or .csv, got {file.suffix}; set the stage's format")


def shaped(file: External, what: str, array: np.ndarray, columns: int | None) -> np.ndarray:
    """`array` as numbers of shape (k, columns), or (k,) for None ((k, 1) is taken as that); raises ValueError
    otherwise."""
    if columns is None and array.ndim == 2 and array.shape[1] == 1:
        array = array[:, 0]
    fits = array.ndim == 1 if columns is None else array.ndim == 2 and array.shape[1] == columns
    if not fits or array.dtype.kind not in "iuf":
        wanted = "(k,)" if columns is None else f"(k, {columns})"
        raise ValueError(
            f"{file.shape}: expected {what} of {wanted} numbers, got {array.dtype} {array.shape}; write it again"
        )
    return array


def whole(file: External, what: str, array: np.ndarray) -> np.ndarray:
    """`array` as whole numbers (k,) int64; raises ValueError otherwise."""
    values = shaped(file, what, array, None)
    if not np.isfinite(values).all() or (values != np.round(values)).any():
        raise ValueError(f"{file.shape}: expected whole numbers as {what}, got others; write it again")
    return values.astype(np.int64)
