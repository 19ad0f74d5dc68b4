"""b23d: few-shot 3D keypoints and back-projected 2D features. The front door; the rooms are `b23d.pipeline`,
`.schemas`, `.stages`.

>>> import b23d
>>> run = b23d.load("runs/demo.toml")

`pipeline`, `schemas` and `stages` in this folder are links to the folders beside it, which can be imported by no other
name.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from b23d.stages.workbench.api.features import features
    from b23d.stages.workbench.api.keypoints import keypoints
    from b23d.stages.workbench.api.matching import match
    from b23d.stages.workbench.api.run import LoadedRun, load

__all__ = ["LoadedRun", "features", "keypoints", "load", "match"]

ROOMS = {"LoadedRun": "run", "features": "features", "keypoints": "keypoints", "load": "run", "match": "matching"}


def __getattr__(name: str) -> Any:
    """The API, imported when first asked for: `import b23d` alone costs nothing."""
    if name in ROOMS:
        return getattr(import_module(f"b23d.stages.workbench.api.{ROOMS[name]}"), name)
    raise AttributeError(f"b23d: expected one of {', '.join(__all__)}, got {name!r}; see the README's tour")
