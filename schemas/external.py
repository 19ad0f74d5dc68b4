"""What another program made of a shape, as its file stands."""

from __future__ import annotations

from pydantic import Field

from b23d.schemas.artifact import Artifact


class External(Artifact):
    """One file of another program about one shape, not yet read: `stages/imports/` knows the formats."""

    shape: str
    """Name of the shape, for messages: `<class>/<id>`."""
    suffix: str
    """The file's, lower case: .npz, .npy, .txt, .csv or .bin."""
    data: bytes = Field(repr=False)
