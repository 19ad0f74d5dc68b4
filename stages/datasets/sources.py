"""The `source` leaf: a shape's geometry files under names that say nothing of where they lie."""

from __future__ import annotations

import posixpath
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Leaf
from b23d.schemas.shape import Source


def source_leaf(name: str, mesh: str | None, cloud: str | None, companions: dict[str, Path] | None = None) -> Leaf:
    """The `source` leaf of the shape called `name`: `mesh.<suffix>`, `cloud.<suffix>`, and companions by relative
    name."""
    files: dict[str, Path] = {}
    values: dict[str, Any] = {}
    own_names: dict[str, str] = {}
    for role, path in (("mesh", mesh), ("cloud", cloud)):
        if path is not None:
            values[role] = role + posixpath.splitext(path)[1].lower()
            files[values[role]] = Path(path)
            own_names[values[role]] = posixpath.basename(path)
    return Leaf(load_source, values, {**(companions or {}), **files}, context={"shape": name, "own_names": own_names})


def load_source(files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """A Source of the files' bytes; `values` says which is the mesh and which the cloud."""
    return Source(
        shape=values.get("shape", "the shape"),
        files=files,
        mesh=values.get("mesh"),
        cloud=values.get("cloud"),
        own_names=values.get("own_names", {}),
    )
