"""Why a shape of the run has no node of a stage."""

from __future__ import annotations

from b23d.pipeline.dataset import Shape
from b23d.pipeline.planning.plan import Plan


def why_absent(plan: Plan, shape: Shape, stage: str, draw: int | None) -> str:
    """draw: the one that was asked for; None: any."""
    if shape.error:
        return shape.error
    with_shots = not any(name == stage and seed is None for name, _, seed in plan.by_shape)
    if with_shots and (why := plan.no_shots(shape.category)):
        return why
    own = [each for each in plan.draws if each.category == shape.category]
    if draw is not None and draw not in [each.seed for each in own]:
        return f"draws of its class are {', '.join(str(each.seed) for each in own)}"
    shot_of = [
        each.seed for each in own if shape.name in [shot.name for shot in each.shots] and draw in (None, each.seed)
    ]
    if with_shots and shot_of:
        draws = f"draw{'s' if len(shot_of) > 1 else ''} {', '.join(map(str, shot_of))}"
        return f"it is a shot of {draws}, and a shot has no prediction in its own draw"
    return "what it is made of is lacking: a score of a shape without keypoints, say"
