"""The Python API: `b23d.pipeline.run.Run` with what knows 3D: scores as a DataFrame, plots, the report.

>>> import b23d
>>> run = b23d.load("runs/demo.toml", "stages.reweight.sigma=0.02")
>>> run.execute()
>>> run.scores
>>> run.plot("chair/chair-0003")
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from b23d.pipeline.config import load_config
from b23d.pipeline.run import Run

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


class LoadedRun(Run):
    """A run to plan, execute, open and look at in a notebook."""

    @property
    def scores(self) -> pd.DataFrame:
        """One row per class and threshold: iou, iou_sd, pck (labelled), the class's auc. Raises ValueError before
        anything is scored."""
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
                "auc": scores.auc.mean,
                "targets": scores.targets,
            }
            for name, scores in table.classes.items()
            for at, mean, sd, pck in zip(
                scores.thresholds, scores.iou.mean, scores.iou.sd, scores.pck.mean, strict=True
            )
        ]
        return pd.DataFrame(rows)

    def plot(self, shape: str, draw: int | None = None) -> go.Figure:
        """The shape with its features' PCA colours, predicted and annotated keypoints."""
        from b23d.stages.workbench.pictures.figures import plot_shape

        return plot_shape(self, shape, draw)


def load(path: str | Path, *overrides: str, store: str | None = None) -> LoadedRun:
    """A run file with overrides (`"stages.reweight.sigma=0.02"`), ready to plan and execute."""
    return LoadedRun(load_config(path, overrides), store)
