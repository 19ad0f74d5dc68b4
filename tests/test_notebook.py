"""The notebook of the README: it runs, and what is kept in it is of the kind that comes out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.notebooks import TOUR, run_notebook


def kinds(cell: dict[str, Any]) -> list[list[str]]:
    """What sorts of output a cell has: printed, or a value as text and HTML."""
    return [sorted(output.get("data", {"printed": ""})) for output in cell["outputs"]]


@pytest.mark.slow
def test_the_tour_runs_and_its_outputs_are_kept(tmp_path: Path) -> None:
    shutil.copy(TOUR.parent / "demo.toml", tmp_path)
    kept = [cell for cell in json.loads(TOUR.read_text())["cells"] if cell["cell_type"] == "code"]
    ran = [cell for cell in run_notebook(TOUR, tmp_path) if cell["cell_type"] == "code"]
    for old, new in zip(kept, ran, strict=True):
        assert kinds(new) == kinds(old), "".join(old["source"])
    assert sum(bool(cell["outputs"]) for cell in kept) >= 8
    assert "0 failures" in json.dumps(ran)
