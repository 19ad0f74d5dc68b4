"""Constants of the posterior method's search. Chosen on KeypointNet's bathtubs and beds, those for turns also on
procedural shapes, then left as they are for every class."""

from __future__ import annotations

from pydantic import Field

from b23d.schemas.params import Params


class PosteriorParams(Params):
    keypoint_weight: float = 1.5
    """Weight of "is a keypoint at all", pooled over ids: three shots have some forty examples of it."""
    identity_weight: float = 0.5
    """Weight of "is this keypoint rather than another"."""
    plain_after: float = Field(9.0, gt=0)
    """With so many further examples of an id, both weights are half-way to 1: the plain discriminant of its own
    examples against all points."""
    shift_sd: float = Field(0.2, gt=0)
    """Standard deviation of the mean-shift vectors, in radii, before the shots have shown theirs."""
    shift_worth: float = Field(10.0, gt=0)
    """Shots that this counts as beside what they show."""
    distance_weight: float = Field(2.0, ge=0)
    """Weight of the geodesic distances between keypoints."""
    distance_sd: float = Field(0.05, gt=0)
    """Of distances, in the shape's largest."""
    turns: int = Field(24, ge=1)
    """Turns of a target that are tried, where the shots stand differently."""
    turn_concentration: float = Field(20.0, gt=0)
    """Of the von Mises prior that a target stands as a shot does; 20 is a standard deviation of 13°."""
    sides_sd: float = Field(0.25, gt=0)
    """Standard deviation of the logarithms of the box's sides, for judging turns."""
    surface_weight: float = Field(300.0, ge=0)
    """Nats that full overlap of a target's surface with the shots' counts for a turn."""
    contrast_weight: float = Field(60.0, ge=0)
    """Nats that a shape counts for a turn that differs from itself turned half round just as all shots do."""
    temper: float = Field(2.0, ge=1)
    """Divides the evidence for a turn: keypoints of one shape are less independent than the bound has it."""
    iterations: int = Field(6, ge=1)
    """Of the mean field, over all keypoints in turn."""
    hit_radius: float = Field(0.08, gt=0)
    """How near counts as a hit when a point is chosen, in largest box sides."""
    present: float = Field(0.5, ge=0, le=1)
    """Least probability for a group of ids to be judged present by the evidence: by how often shots like the target
    have them, how sharply they are found, and how much what is found looks like them."""
