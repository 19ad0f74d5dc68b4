"""Shapes whose up axis is to be found are shown as they stand, as far as anybody knows."""

from __future__ import annotations

from b23d.pipeline.errors import ArtifactNotFoundError
from b23d.pipeline.run import Run
from b23d.schemas.orientation import Orientation
from b23d.schemas.shape import Source


def standing(run: Run, name: str, source: Source) -> Source:
    """The source with the up axis that the run has found for it, where its data set says `up = "auto"`; before that has
    run, with the one that a flat underside tells. Raises ValueError, naming the shape, where `normalize` does."""
    if source.up is not None:
        return source
    found = _found(run, name)
    if found is None:
        from b23d.stages.orient import OrientParams, orient

        found = orient(source, None, params=OrientParams())
    return source.model_copy(update={"up": found.axis})


def _found(run: Run, name: str) -> Orientation | None:
    try:
        found = run.artifact(name, "orient")
    except (KeyError, ArtifactNotFoundError):
        return None
    return found if isinstance(found, Orientation) else None
