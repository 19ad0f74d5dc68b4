"""Part labels of one shape."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class Parts(Artifact):
    """Human (or exact, procedural) part labels of one shape, at points of its surface."""

    points: Annotated[np.ndarray, ArraySpec("p 3", "float64", unit="source frame")]
    labels: Annotated[np.ndarray, ArraySpec("p", "int32")]
    names: list[str] = []
