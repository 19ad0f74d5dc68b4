"""Predicted keypoints and their scores, one shape and one draw of shots at a time."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from schemas.artifact import ArraySpec, Artifact


class Prediction(Artifact):
    """Keypoints found on one target; what `optimize` and `detect` give."""

    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Semantic ids, from the shots; -1 for detectors that know no names."""
    points: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Index of the chosen candidate."""
    positions: Annotated[np.ndarray, ArraySpec("k 3", "float32", unit="unit frame")]
    present: Annotated[np.ndarray, ArraySpec("k", "bool")]
    """False: the id occurs in the shots but is judged absent here; such rows are kept for inspection, never scored as predictions."""
    costs: Annotated[np.ndarray, ArraySpec("k", "float32", unit="objective; lower is better")]
    """Each keypoint's share of the objective."""
    objective: float
    """Value reached of the method's objective L_feature + α L_distance, comparable between methods on equal inputs."""
    method: str
    shots: list[str] = []
    """Names of the shots used (after retrieval, if any)."""


class ShapeScore(Artifact):
    """How one prediction compares with one annotation, at every threshold. Sums over a class give its micro-averages."""

    thresholds: Annotated[np.ndarray, ArraySpec("t", "float64", unit="data set's units")]
    true_positives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Label-agnostic, many-to-one (KeypointNet, UKPGAN): annotated keypoints with a prediction within the threshold."""
    false_positives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    false_negatives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    matched: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Pairs of the largest one-to-one matching within the threshold, label-agnostic."""
    labelled: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Annotated keypoints whose own id is predicted within the threshold (labelled PCK's numerator)."""
    symmetric: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """The same after the best exchange of ids that a symmetry of the shape permits."""
    annotated: int
    predicted: int
    common: int
    """Ids both predicted and annotated: presence's true positives."""
    ceiling: Annotated[np.ndarray, ArraySpec("2", "int32", unit="intersection, union")]
    """Ids seen in the shots against ids annotated: the IoU of a perfect labelled predictor that predicts every id of the shots."""
    distances: Annotated[np.ndarray, ArraySpec("k g", "float32", unit="data set's units")]
    """Geodesic distance of every present prediction from every annotated keypoint."""
    protocol: str
    annotation_file: str
    """sha256 of the annotation file the keypoints came from (KeypointNet's labels have drifted over the years)."""
