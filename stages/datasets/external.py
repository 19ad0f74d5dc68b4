"""Files of other programs about a data set's shapes: a folder with `<id>.<suffix>`, or `<class>/<id>.<suffix>`, for
each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Dataset, Leaf
from b23d.schemas.external import External
from b23d.stages.datasets.files import walk

SUFFIXES = (".npz", ".npy", ".txt", ".csv", ".bin")


class WithExternals(Dataset):
    """A data set whose shapes may have files of other programs."""

    external_predictions: Path | None = None
    """Folder with another system's keypoints, one file a shape: `<id>.<suffix>` or `<class>/<id>.<suffix>` of .npz .npy
    .txt .csv .bin. The stage `import_predictions` reads them. Shapes without a file get no imported prediction."""
    external_features: Path | None = None
    """The same for another system's point features; read by `import_features`."""

    def externals(self) -> Externals:
        """The files there are. Raises FileNotFoundError or ValueError (two files for one shape)."""
        return Externals(
            {"external_predictions": self.external_predictions, "external_features": self.external_features}
        )


class Externals:
    """The listed folders: each is read once for all shapes."""

    def __init__(self, folders: dict[str, Path | None]) -> None:
        self._files = {name: _listed(name, folder) for name, folder in folders.items() if folder is not None}

    def leaves(self, category: str, shape: str) -> dict[str, Leaf]:
        """The leaves of the shape `<category>/<shape>` for which there is a file; one in the category's own folder goes
        first."""
        name = f"{category}/{shape}"
        found = {leaf: files.get(name, files.get(shape)) for leaf, files in self._files.items()}
        return {leaf: _leaf(name, path) for leaf, path in found.items() if path is not None}


def load_external(files: dict[str, bytes], values: dict[str, Any]) -> External:
    """An External of the only file's bytes."""
    ((name, data),) = files.items()
    return External(shape=values.get("shape", "the shape"), suffix=name.removeprefix("external"), data=data)


def _leaf(name: str, path: Path) -> Leaf:
    return Leaf(load_external, {}, {f"external{path.suffix.lower()}": path}, context={"shape": name})


def _listed(name: str, folder: Path) -> dict[str, Path]:
    """The folder's files by their place below it, without the suffix."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{name}: expected a folder {folder}, got none; set dataset.{name}")
    files: dict[str, Path] = {}
    for path, place in walk(folder).items():
        key, dot, suffix = place.rpartition(".")
        if f"{dot}{suffix}".lower() in SUFFIXES:
            if key in files:
                raise ValueError(
                    f"{name}: expected one file for {key}, got {files[key].name} and {Path(path).name}; remove one"
                )
            files[key] = Path(path)
    if not files:
        raise FileNotFoundError(
            f"{name}: expected files of {' '.join(SUFFIXES)} in {folder}, got none; set dataset.{name}"
        )
    return files
