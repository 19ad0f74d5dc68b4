"""`b23d.keypoints`: from a folder with a few annotated shapes to the keypoints of all others, in one call."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from b23d.schemas.wording import counted
from b23d.stages.datasets.folder import Folder
from b23d.stages.datasets.survey import survey
from b23d.stages.workbench.api.arguments import ShotChoice, path_of, shots_of, store_of, workers_of
from b23d.stages.workbench.api.features import store_place, with_encoder
from b23d.stages.workbench.api.run import LoadedRun, load
from b23d.stages.workbench.results.keypoints import keypoint_table
from b23d.stages.workbench.results.run_file_text import run_file_text, run_name

if TYPE_CHECKING:
    import pandas as pd


def keypoints(
    folder: str | Path,
    shots: int | Iterable[str] | Mapping[str, Iterable[str]] | None = None,
    *,
    encoder: str | None = None,
    overrides: Iterable[str] = (),
    store: str | None = None,
    workers: int | None = None,
) -> pd.DataFrame:
    """Keypoints of every shape that is not a shot, one row each, in the files' own coordinates; columns as
    `b23d keypoints` writes them.

    folder: meshes or clouds, with keypoints.json in it; or a run file. shots: how many annotated shapes of each class
    are shown; or which, as ids of the only class, or as class → ids; None: three, or as many as there are.
    Other arguments: as `b23d.features`, and `workers` as `Run.execute`. Raises FileNotFoundError or ValueError where
    the folder cannot be used, RuntimeError where no shape was predicted.
    """
    path = path_of("folder", folder, "a folder of shapes, or a run file").expanduser()
    chosen, store, workers, shown = (
        with_encoder(overrides, encoder),
        store_of(store),
        workers_of(workers),
        shots_of(shots),
    )
    file = path if path.is_file() else _run_file(path, store)
    place = None if path.is_file() and store is None else store_place(store)
    run: LoadedRun = load(file, *chosen, *_overrides(shown, file), store=place)
    report = run.execute(workers)
    table = keypoint_table(run).table
    if not len(table):
        raise RuntimeError("\n".join(failure.error for failure in report.failures) or "keypoints: nothing to predict")
    return table


def _run_file(folder: Path, store: str | None) -> Path:
    """The run file of a folder, as `b23d init` would write it; in `.given` of a local store, so that `b23d gc` knows
    it, else beside the folder."""
    found = survey(folder)
    if not found.annotated and not Folder(root=folder).unannotated():
        shapes = Folder(root=folder).shapes()
        raise ValueError("\n".join(s.error for s in shapes if s.error and s.id.startswith("keypoints.json")))
    if not found.annotated:
        raise ValueError(
            f"{folder}: expected annotated shapes, got {found.shapes} without; b23d init and b23d annotate make them"
        )
    name = run_name(folder)
    place = folder.parent if "://" in (store or "") else Path(store_place(store), ".given")
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"{name}.toml"
    path.write_text(run_file_text(found, name, place), encoding="utf-8")
    return path


def _overrides(shots: ShotChoice, file: Path) -> list[str]:
    """As overrides of the run file."""
    if shots is None:
        return []
    if isinstance(shots, int):
        return [f"shots.count={shots}"]
    classes = {shape.category for shape in load(file).shapes}
    if not isinstance(shots, dict):
        if len(classes) > 1:
            raise ValueError(
                f"shots: expected class → ids for {counted(len(classes), 'class')}, got ids alone; give a dict"
            )
        shots = {next(iter(classes)): shots}
    if unknown := sorted(shots.keys() - classes):
        raise ValueError(f"shots: expected classes among {', '.join(sorted(classes))}, got {', '.join(unknown)}")
    return [f"shots.ids={json.dumps(shots)}"]
