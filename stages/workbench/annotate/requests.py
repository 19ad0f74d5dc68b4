"""What the page may ask: every field checked before anything is done."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator

from b23d.schemas.wanted import wanted

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Id = Annotated[int, Field(ge=0, lt=2**31, strict=True)]


class Request(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class HitRequest(Request):
    """A ray from the viewer, unit frame."""

    origin: Vector
    direction: Vector
    within: Annotated[Number, Field(ge=0, le=0.2)] = 0.0
    """A ray that misses takes the surface at most so far beside it, for each unit that it is away."""
    extremity: bool = False
    """The tip beside the place is meant."""

    @field_validator("direction")
    @classmethod
    def _not_zero(cls, direction: list[float]) -> list[float]:
        if not any(direction):
            raise ValueError("a direction that is not zero")
        return direction


class Beside(Request):
    """Other programs' annotations have more here, and sometimes less."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class MeshInfo(Beside):
    face_index: Id | None = None
    face_uv: Vector | None = None


class PointInfo(Beside):
    point_index: Id | None = None


class PlacedAt(Request):
    xyz: Vector
    mesh_info: MeshInfo | None = None
    pcd_info: PointInfo | None = None


class EditedKeypoint(Request):
    id: Id
    was: Id | None
    hit: PlacedAt | None
    name: Annotated[str, Field(max_length=80)] | None = None


class SaveRequest(Request):
    keypoints: Annotated[list[EditedKeypoint], Field(max_length=100_000)]
    given: str
    """Tag of the entry that the page was given."""
    force: bool = False


def told(errors: list[Any]) -> str:
    """What pydantic found, in a line."""
    return "; ".join(f"{'.'.join(map(str, e['loc'])) or 'the request'}: expected {wanted(e)}" for e in errors[:3])
