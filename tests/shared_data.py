"""Real shapes that lie beside the project, not in it. Tests that need them skip where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(os.environ.get("B23D_SHARED", Path(__file__).parents[2] / "shared")) / "data"


def shared(path: str) -> Path:
    """`<shared>/data/<path>`; skips the test where it is absent (set B23D_SHARED to a folder that has `data/`)."""
    if not (ROOT / path).exists():
        pytest.skip(f"needs {ROOT / path}: the shared development data is not here")
    return ROOT / path
