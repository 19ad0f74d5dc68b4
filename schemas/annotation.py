"""How well a shape's annotation fits its geometry."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class AnnotationCheck(Artifact):
    """An annotation that lies on its shape, as far as it does."""

    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    distances: Annotated[np.ndarray, ArraySpec("k", "float32", unit="unit frame")]
    """How far each keypoint is from the surface at most (of a cloud: from its nearest point)."""
    warnings: list[str] = []
    """What is odd, but was let pass."""
