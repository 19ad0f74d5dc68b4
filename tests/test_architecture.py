"""The house: workbench → stages → pipeline's declaration → schemas. zarr in the store, dask in the scheduler."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

DEFINITIONS = (ast.FunctionDef, ast.ClassDef)
ROOT = Path(__file__).parents[1]
PACKAGES = ("schemas", "pipeline", "stages")
FILES = sorted(path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
TESTS = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("*.py"))
DECLARATION = {"pipeline.stage", "pipeline.dataset", "pipeline.errors"}
"""All of the engine that a stage may know."""
FLOORS = ["schemas", "declaration", "engine", "science", "results", "pictures", "pages", "api", "verbs"]
"""From the ground up; a file imports from its own floor or from below; science knows the declaration only."""
WORKBENCH = {
    "stages/workbench/results/": "results",
    "stages/workbench/pictures/": "pictures",
    "stages/workbench/report/": "pages",
    "stages/workbench/analyses/": "pages",
    "stages/workbench/annotate/": "pages",
    "stages/workbench/api/": "api",
    "stages/workbench/commands/": "verbs",
}
ONLY = {
    "zarr": {"pipeline/store.py"},
    "dask": {"pipeline/scheduler.py", "pipeline/cluster.py"},
    "distributed": {"pipeline/scheduler.py", "pipeline/cluster.py"},
}


def floor(path: str) -> str:
    """The floor that a file (or a module's path without its suffix) is on."""
    for prefix, name in WORKBENCH.items():
        if path.startswith(prefix.removesuffix(".py")):
            return name
    package = path.split("/")[0]
    if package == "pipeline":
        module = path.removesuffix(".py").replace("/", ".")
        return "declaration" if module in DECLARATION else "engine"
    return {"schemas": "schemas", "stages": "science"}[package]


def imports(path: str) -> set[str]:
    """Every module a file imports; `from b23d.stages import render` counts as b23d.stages."""
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
    own = floor(path)
    for name in imports(path):
        root = name.split(".")[0]
        assert root not in PACKAGES, f"{path} imports {name}: write b23d.{name}"
        assert path in ONLY.get(root, {path}), f"{path} imports {name}: only {', '.join(sorted(ONLY[root]))} may"
        inner = name.removeprefix("b23d.").replace(".", "/")
        if root != "b23d" or inner.split("/")[0] not in PACKAGES:
            continue
        above = floor(inner)
        assert FLOORS.index(above) <= FLOORS.index(own), f"{path} ({own}) imports {name} ({above}): upwards"
        assert own != "science" or above != "engine", f"{path} imports {name}: a stage knows the declaration"


def test_stages_never_read_files_of_their_own() -> None:
    """A stage is a function of arrays: no open(), no path. (Encoders read weights: that is what they are.)"""
    for path in (ROOT / "stages").glob("*.py"):
        calls = (node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
        assert "open" not in {call.id for call in calls if isinstance(call, ast.Name)}, path


def test_planning_imports_nothing_heavy() -> None:
    heavy = ("torch", "transformers", "trimesh", "scipy", "pandas", "distributed", "plotly")
    code = f"""
import sys, b23d, b23d.stages, b23d.pipeline.run, b23d.pipeline.cli
print([m for m in {heavy} if m in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_one_name(package: str) -> None:
    """Under a second name there would be a second registry of stages."""
    done = subprocess.run([sys.executable, "-c", f"import {package}"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 1 and f"expected to be imported as b23d.{package}" in done.stderr


@pytest.mark.parametrize("path", FILES + TESTS)
def test_files_are_rooms_not_halls(path: str) -> None:
    assert len((ROOT / path).read_text().splitlines()) <= 300, f"{path}: over 300 lines; split it by idea"


def test_no_cited_file_is_missing() -> None:
    """A path in backticks or in a help text that this repository does not have sends readers nowhere."""
    for path in FILES:
        for cited in re.findall(r"`((?:schemas|pipeline|stages|tests|runs)/[\w/.-]+)`", (ROOT / path).read_text()):
            assert (ROOT / cited).exists(), f"{path} cites {cited}"


def test_no_two_public_types_share_a_name() -> None:
    """One word, one meaning. Only analyses share a word on purpose: each module has its own `Parameters`."""
    homes: dict[str, list[str]] = {}
    for path in FILES:
        for node in ast.parse((ROOT / path).read_text()).body:
            names = [node.name] if isinstance(node, ast.ClassDef) else []
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                alias = node.targets[0].id
                names += [alias] if alias[0].isupper() and not alias.isupper() else []
            for name in names:
                homes.setdefault(name, []).append(path)
    shared = {name: paths for name, paths in homes.items() if len(paths) > 1 and not name.startswith("_")}
    assert shared.pop("Parameters") and shared == {}


def test_shared_options_are_declared_once() -> None:
    """Their words and their help are the same in every verb; a verb that needs another meaning needs another word."""
    declared: dict[str, list[str]] = {}
    for path in FILES:
        for option in re.findall(
            r'typer\.Option\([^)]*?"--(set|store|json|limit|workers)\b', (ROOT / path).read_text()
        ):
            declared.setdefault(option, []).append(path)
    assert all(paths == ["pipeline/verbs/options.py"] for paths in declared.values()), declared
    assert declared.keys() >= {"set", "store", "json", "limit"}


def test_nothing_lives_for_its_tests_alone() -> None:
    """A function or class that only its own definition names is dead: nobody but a test can call it."""
    sources = [(ROOT / path).read_text() for path in FILES]
    words = Counter(re.findall(r"\w+", "\n".join([*sources, (ROOT / "pyproject.toml").read_text()])))
    named = [node.name for text in sources for node in ast.parse(text).body if isinstance(node, DEFINITIONS)]
    assert [name for name in named if words[name] == 1] == []
