"""Imports run one way: stages → pipeline's declaration → schemas. zarr only in the store, dask only in the scheduler."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {"schemas": {"schemas"}, "pipeline": {"pipeline", "schemas"}, "stages": {"stages", "pipeline", "schemas"}}
DECLARATION = {"pipeline.stage", "pipeline.dataset"}
ABOVE_THE_ENGINE = {"stages/analyses", "stages/commands", "stages/report", "stages/api.py"}   # verbs that know 3D: they use the run's API
FILES = sorted(path.relative_to(ROOT).as_posix() for package in ALLOWED for path in (ROOT / package).rglob("*.py"))


def imports(path: str) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", FILES)
def test_imports_run_one_way(path: str) -> None:
    package = path.split("/")[0]
    for name in imports(path):
        root = name.split(".")[0]
        assert root not in ALLOWED or root in ALLOWED[package], f"{path} imports {name}"
        assert root != "zarr" or path == "pipeline/store.py", f"{path} imports zarr"
        assert root not in ("dask", "distributed") or path == "pipeline/scheduler.py", f"{path} imports {name}"
        if package == "stages" and root == "pipeline" and not any(path.startswith(part) for part in ABOVE_THE_ENGINE):
            assert name in DECLARATION, f"{path} imports {name}: a stage knows the engine's declaration only"


def test_stages_never_read_files_of_their_own() -> None:
    """A stage is a function of arrays: no open(), no path. (Encoders read weights: that is what they are.)"""
    for path in (ROOT / "stages").glob("*.py"):
        calls = (node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
        assert "open" not in {call.id for call in calls if isinstance(call, ast.Name)}, path


def test_planning_imports_nothing_heavy() -> None:
    import subprocess
    import sys

    heavy = ("torch", "transformers", "trimesh", "scipy", "pandas", "distributed", "plotly")
    code = f"import sys, stages, pipeline.run, pipeline.cli; print([m for m in {heavy} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout.strip() == "[]"
