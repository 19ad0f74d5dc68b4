"""Params: what a user may set on a stage or a data set. Closed, frozen, printed in full, hashed in full."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class Unhashed:
    """Marks a field that says where something is, not what it is: it never enters an address.

    >>> weights: Annotated[Path | None, Unhashed()] = None
    """


class Params(BaseModel):
    """Base of every stage's and data set's parameters.

    Unknown keys, NaN and infinities are errors; instances are immutable. All fields, defaults included, enter the
    address of what the stage makes, except those marked `Unhashed`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    def hashed(self) -> dict[str, Any]:
        """The fields that enter an address, as JSON values."""
        unhashed = {
            name
            for name, field in type(self).model_fields.items()
            if any(isinstance(m, Unhashed) for m in field.metadata)
        }
        return self.model_dump(mode="json", exclude=unhashed)
