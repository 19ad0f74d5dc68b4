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
    from b23d.stages.workbench.api import LoadedRun, load

__all__ = ["LoadedRun", "load"]


def __getattr__(name: str) -> Any:
    """The API, imported when first asked for: `import b23d` alone costs nothing."""
    if name in __all__:
        return getattr(import_module("b23d.stages.workbench.api"), name)
    raise AttributeError(f"b23d: expected one of {', '.join(__all__)}, got {name!r}; see the README's tour")
