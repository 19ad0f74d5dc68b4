"""Files of other programs about a data set's shapes: a folder with `<id>.<suffix>`, or `<class>/<id>.<suffix>`, for
each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Dataset, Leaf
from b23d.schemas.external import External
from b23d.stages.datasets.walking import walk

SUFFIXES = (".npz", ".npy", ".txt", ".csv", ".bin")


class WithExternals(Dataset):
    """A data set whose shapes may have files of other programs."""

    external_predictions: Path | None = None
    """Folder with another system's keypoints, one file a shape: `<id>.<suffix>` or `<class>/<id>.<suffix>` of .npz .npy
    .txt .csv .bin. The stage `import_predictions` reads them. Shapes without a file get no imported prediction."""
    external_features: Path | None = None
    """The same for another system's point features; read by `import_features`."""

    def externals(self) -> Externals:
        """The files there are. Raises FileNotFoundError where there is no such folder, or none in it."""
        return Externals(
            {"external_predictions": self.external_predictions, "external_features": self.external_features}
        )


class Externals:
    """The listed folders: each is read once for all shapes."""

    def __init__(self, folders: dict[str, Path | None]) -> None:
        self._files = {name: _listed(name, folder) for name, folder in folders.items() if folder is not None}

    def leaves(self, category: str, shape: str) -> dict[str, Leaf]:
        """The leaves of the shape `<category>/<shape>` for which there is a file; one in the category's own folder goes
        first. Where the file cannot be used, reading the leaf says so: the shape loses nothing else."""
        name = f"{category}/{shape}"
        found = {leaf: files.get(name, files.get(shape)) for leaf, files in self._files.items()}
        return {leaf: _leaf(name, file) for leaf, file in found.items() if file is not None}


def load_external(files: dict[str, bytes], values: dict[str, Any]) -> External:
    """An External of the only file's bytes."""
    ((name, data),) = files.items()
    return External(shape=values.get("shape", "the shape"), suffix=name.removeprefix("external"), data=data)


def refuse_external(files: dict[str, bytes], values: dict[str, Any]) -> External:
    """Raises ValueError: what listing the folder found wrong."""
    raise ValueError(f"{values['shape']}: {values['refused']}")


def _leaf(name: str, file: Path | str) -> Leaf:
    if isinstance(file, str):
        return Leaf(refuse_external, {"refused": file}, context={"shape": name})
    return Leaf(load_external, {}, {f"external{file.suffix.lower()}": file}, context={"shape": name})


def _listed(name: str, folder: Path) -> dict[str, Path | str]:
    """The folder's files by their place below it, without the suffix; a text says why one cannot be used."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{name}: expected a folder {folder}, got none; set dataset.{name}")
    files: dict[str, Path | str] = {}
    listing = walk(folder)
    for path, place in listing.files.items():
        key = _key(place)
        other = None if key is None else files.get(key)
        if key is not None and other is None:
            files[key] = Path(path)
        elif key is not None:
            names = f"{other.name if isinstance(other, Path) else 'several'} and {Path(path).name}"
            files[key] = f"{name}: expected one file for {key}, got {names}; remove one"
    for place, reason in listing.strange.items():
        if (key := _key(place)) is not None:
            files.setdefault(key, f"{name}: {place}: {reason}")
    if not files:
        raise FileNotFoundError(
            f"{name}: expected files of {' '.join(SUFFIXES)} in {folder}, got none; set dataset.{name}"
        )
    return files


def _key(place: str) -> str | None:
    """The place without its suffix, if it is one of ours."""
    key, dot, suffix = place.rpartition(".")
    return key if f"{dot}{suffix}".lower() in SUFFIXES else None
