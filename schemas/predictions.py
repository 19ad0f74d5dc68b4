"""What is predicted on one target with one draw of shots: keypoints, or part labels."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class Prediction(Artifact):
    """Keypoints found on one target; what `optimize` and `detect` give."""

    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Semantic ids, from the shots; -1 for detectors that know no names."""
    points: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Index of the chosen candidate."""
    positions: Annotated[np.ndarray, ArraySpec("k 3", "float32", unit="unit frame")]
    present: Annotated[np.ndarray, ArraySpec("k", "bool")]
    """False: the id occurs in the shots but is judged absent here; such rows are kept for inspection, never scored as
    predictions."""
    costs: Annotated[np.ndarray, ArraySpec("k", "float32", unit="objective; lower is better")]
    """Each keypoint's share of the objective."""
    confidence: Annotated[np.ndarray, ArraySpec("k", "float32", unit="0 … 1")] | None = None
    """Needing no annotation. Of the posterior method: the probability that the target has the keypoint, and has it
    within .05 of this place along the surface (longest side 1), by a map that shots held out of the others' model have
    helped to fit; it presumes that the target is of the shots' class (see `class_confidence`). Of a trained head: its
    probability. None for methods that give none."""
    class_confidence: float | None = None
    """Probability that the target is of the shots' class, by what it looks like as a whole and where it has surface;
    None where a single shot, or copies of one, cannot tell, and from stages that do not judge it."""
    front_margin: float | None = None
    """Nats of evidence by which the turn about the up axis that the shape was given to stand as the shots do beats the
    next best. Near 0 it is a tie: the shape is symmetric as far as the shots tell. None where no turn was looked for,
    as three shots or more stand alike."""
    objective: float
    """Value reached of the method's objective L_feature + α L_distance, comparable between methods on equal inputs."""
    method: str
    shots: list[str] = []
    """Names of the shots used (after retrieval, if any)."""


class PartPrediction(Artifact):
    """A part label for every candidate of one target; what `transfer` gives."""

    labels: Annotated[np.ndarray, ArraySpec("n", "int32")]
    """Index into `names`."""
    confidence: Annotated[np.ndarray, ArraySpec("n", "float32", unit="share of the votes, 0 … 1")]
    names: list[str]
    """The parts of the category, whether or not they occur in the shots."""
    method: str
