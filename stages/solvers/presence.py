"""Which of the ids that the shots have does the target have, too?"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from b23d.stages.solvers.template import Template

Presence = Literal["all", "majority", "evidence"]


def presence(template: Template, rule: Presence) -> npt.NDArray[np.bool_]:
    """Whether each id of the template is judged present on the target, (k,) bool.

    rule "all": every id (the paper). "majority": ids that more than half of the shots have. "evidence": every id, where
    a method has no evidence of its own.
    """
    if rule == "majority":
        return np.asarray(2 * template.counts > template.of)
    return np.ones(len(template.ids), dtype=bool)
