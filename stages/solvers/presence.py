"""Which of the ids that the shots have does the target have, too?"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from b23d.stages.solvers.shots import Template

Presence = Literal["all", "majority", "evidence"]


def presence(costs: np.ndarray, template: Template, rule: Presence) -> npt.NDArray[np.bool_]:
    """Whether each id of the template is judged present on the target, (k,) bool.

    costs: (k,) each keypoint's share of the objective reached; no rule uses it yet.
    rule "all": every id (the paper). "majority": ids that more than half of the shots have. "evidence": every id, where
    a method has no evidence of its own.
    """
    if len(costs) != len(template.ids):
        raise ValueError(
            f"presence: expected a cost for each of {len(template.ids)} ids, got {len(costs)}; give the template's own"
        )
    if rule == "majority":
        return 2 * template.counts > len(template.shots)
    return np.ones(len(template.ids), dtype=bool)
