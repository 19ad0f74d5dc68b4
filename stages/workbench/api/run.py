"""The Python API: `b23d.pipeline.run.Run` with what knows 3D: scores as a DataFrame, plots, the report.

>>> import b23d
>>> run = b23d.load("runs/demo.toml", "stages.optimize.method=discrete")
>>> run.execute()
>>> run.scores
>>> run.plot("chair/chair-0003")
"""

from __future__ import annotations

import html
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.run import Report, Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.schemas.wording import counted
from b23d.stages.workbench.api.arguments import path_of, store_of, texts_of, workers_of
from b23d.stages.workbench.api.guard import unguarded_script
from b23d.stages.workbench.api.progress import NotebookProgress, in_notebook

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


class LoadedRun(Run):
    """A run to plan, execute, open and look at in a notebook."""

    def execute(
        self,
        workers: int | None = None,
        scheduler: str | None = None,
        selection: Selection = EVERYTHING,
        watch: Callable[[Plan, Outcome | Task], None] | None = None,
        on_start: Callable[[Plan, str], None] | None = None,
    ) -> Report:
        """As the engine's, and progress is shown in a notebook, if nobody else watches.

        A script without `if __name__ == "__main__":` runs everything in its own process, since every worker process
        would run the script again; where workers are asked for, RuntimeError says so.
        """
        workers = workers_of(workers)
        if not scheduler and workers != 0 and (script := unguarded_script()) is not None:
            advice = 'put its code under `if __name__ == "__main__":`'
            if workers is not None:
                raise RuntimeError(f"execute: expected a script that workers can import, got {script}; {advice}")
            if self.config.file.execution.workers != 0:
                print(f"b23d: running in this process alone; {script}: {advice} to use all cores", file=sys.stderr)
            workers = 0
        if watch is None and on_start is None and in_notebook():
            shown = NotebookProgress()
            watch, on_start = shown.watch, shown.start
        nothing: Callable[..., None] = lambda *_: None  # noqa: E731
        return super().execute(workers, scheduler, selection, watch or nothing, on_start or nothing)

    def __repr__(self) -> str:
        shots, file = self.config.file.shots, self.config.file
        draws = f"{counted(len(shots.draws), 'draw')} of {counted(shots.count, 'shot')}"
        return f"<b23d run {file.name}: {self._counted()}; {draws}; outputs {', '.join(file.outputs)}>"

    def _repr_html_(self) -> str:
        return f"<b>{html.escape(self.name)}</b>: {html.escape(self._counted())}{self.plan()._repr_html_()}"

    def _counted(self) -> str:
        classes = sorted({shape.category for shape in self.shapes})
        names = ", ".join(classes[:5]) + (" …" if len(classes) > 5 else "")
        return f"{counted(len(self.shapes), 'shape')} of {names} ({self.config.dataset.kind})"

    @property
    def scores(self) -> pd.DataFrame:
        """One row per class and threshold: iou, iou_sd, pck (labelled), symmetric_pck, the class's auc. Raises
        ValueError before anything is scored."""
        import pandas as pd

        from b23d.stages.workbench.results.scores import run_scores

        table = run_scores(self)
        rows = [
            {
                "class": name,
                "threshold": at,
                "iou": mean,
                "iou_sd": sd,
                "pck": pck,
                "symmetric_pck": symmetric,
                "auc": scores.auc.mean,
                "targets": scores.targets,
            }
            for name, scores in table.classes.items()
            for at, mean, sd, pck, symmetric in zip(
                scores.thresholds,
                scores.iou.mean,
                scores.iou.sd,
                scores.pck.mean,
                scores.symmetric_pck.mean,
                strict=True,
            )
        ]
        return pd.DataFrame(rows)

    @property
    def keypoints(self) -> pd.DataFrame:
        """One row a predicted keypoint, in the files' own coordinates, of each class's first draw; columns as
        `b23d keypoints` writes them."""
        from b23d.stages.workbench.results.keypoints import keypoint_table

        return keypoint_table(self).table

    def plot(self, shape: str, draw: int | None = None) -> go.Figure:
        """The shape with its features' PCA colours, predicted and annotated keypoints."""
        from b23d.stages.workbench.pictures.figures import plot_shape

        if draw is not None:
            self.node(shape, "optimize", draw)  # says which there are
        return plot_shape(self, shape, draw)


def load(path: str | Path, *overrides: str, store: str | None = None) -> LoadedRun:
    """A run file with overrides (`"stages.optimize.method=discrete"`), ready to plan and execute.

    Raises TypeError where an argument is of no such kind, FileNotFoundError or RunFileError (a ValueError) where the
    run file, or an override, does not say what it should.
    """
    named = texts_of("overrides", overrides, "load(path, 'shots.count=5', 'shots.draws=[0]')")
    return LoadedRun(load_config(path_of("path", path, "a run file"), named), store_of(store))
