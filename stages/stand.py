"""stand: how a class's annotated examples stand, brought upright and turned onto each other; `orient` compares with
it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.orientation import ClassFrame
from b23d.schemas.params import Params
from b23d.schemas.shape import Source

if TYPE_CHECKING:
    from b23d.stages.orienting.examples import ExampleShape

OFF = 0.1
"""An example with a keypoint farther than this from its surface, in longest sides, is left out: `annotation` tells."""


class StandParams(Params):
    count: int = Field(512, ge=16)
    """Points of each example's surface."""


@stage(version=1, hints=Hints(memory_gb=0.3))
def stand(example_source: list[Source], example_keypoints: list[Keypoints], params: StandParams) -> ClassFrame:
    """The examples in one upright frame: relative to each other by their keypoints; what is up by what `dataset.up`
    says of one of them, else by flat undersides, else by the files' own +y.

    An example that cannot be read, or whose keypoints do not lie on it, is left out; `annotation` and `normalize` tell
    why. Raises ValueError where none is left.
    """
    from b23d.stages.orienting.examples import standing

    found: list[tuple[str, ExampleShape]] = []
    errors = []
    for source, keypoints in zip(example_source, example_keypoints, strict=True):
        try:
            found.append((source.shape, _example(source, keypoints, params.count)))
        except ValueError as error:
            errors.append(str(error))
    if not found:
        raise ValueError(
            f"{example_source[0].shape}: expected an example to stand by, got {'; '.join(errors)}; mend one"
        )
    names, examples = [name for name, _ in found], [example for _, example in found]
    stood = standing(examples)
    clouds = [e.points @ rotation.T for e, rotation in zip(examples, stood.rotations, strict=True)]
    return ClassFrame(
        points=np.concatenate(clouds).astype(np.float32),
        example=np.repeat(np.arange(len(clouds), dtype=np.int32), [len(cloud) for cloud in clouds]),
        shapes=names,
        axes=stood.axes,
        by=stood.by,
        warnings=_warnings(names[0].split("/")[0], stood.by),
    )


def _example(source: Source, keypoints: Keypoints, count: int) -> ExampleShape:
    from b23d.stages.geometry.upright import stance
    from b23d.stages.normalize import NormalizeParams, normalize
    from b23d.stages.orienting.examples import ExampleShape
    from b23d.stages.solvers.posterior.geometry import squared

    as_it_is = source.model_copy(update={"up": "y"})
    shape = normalize(as_it_is, NormalizeParams(candidates="fps", count=count, colors=False, max_nonfinite=1.0))
    points, places = shape.points.astype(np.float64), shape.to_unit(keypoints.positions)
    off = float(np.sqrt(squared(places, points).min(1)).max(initial=0.0))
    if off > OFF:
        raise ValueError(f"{source.shape}: expected keypoints on its surface, got one {off:.2g} of its size away")
    stood = stance(shape.vertices, shape.faces) if shape.kind == "mesh" else None
    return ExampleShape(points, keypoints.ids, places, stood, source.up)


def _warnings(category: str, by: str) -> list[str]:
    if by != "as they are":
        return []
    return [
        f"class {category}: nothing tells which side of its annotated shapes is up, so all stand as the first of them; "
        'say it of one with dataset.up = {"<class>/<id>" = "…", "*" = "auto"}'
    ]
