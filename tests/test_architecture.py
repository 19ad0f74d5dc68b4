"""The house: workbench → stages → pipeline's declaration → schemas. zarr in the store, dask in scheduling."""

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
FLOORS = [
    *("schemas", "declaration"),
    *("address", "runfile", "storage", "planning", "scheduling", "records", "run", "inspection", "commands", "cli"),
    *("science", "results", "pictures", "pages", "api", "verbs"),
]
"""From the ground up; a file imports from its own floor or from below; science knows the declaration only."""
PLACES = {
    "schemas/": "schemas",
    "pipeline/__init__": "declaration",
    "pipeline/stage": "declaration",
    "pipeline/dataset": "declaration",
    "pipeline/errors": "declaration",
    "pipeline/address": "address",
    "pipeline/runfile/": "runfile",
    "pipeline/store": "storage",
    "pipeline/storage/": "storage",
    "pipeline/planning/": "planning",
    "pipeline/scheduling/": "scheduling",
    "pipeline/records/": "records",
    "pipeline/run": "run",
    "pipeline/inspection/": "inspection",
    "pipeline/verbs/": "commands",
    "pipeline/cli": "cli",
    "stages/": "science",
    "stages/workbench/results/": "results",
    "stages/workbench/pictures/": "pictures",
    "stages/workbench/report/": "pages",
    "stages/workbench/analyses/": "pages",
    "stages/workbench/annotate/": "pages",
    "stages/workbench/api/": "api",
    "stages/workbench/commands/": "verbs",
}
"""Longest beginning of a path → its floor."""
ONLY = {"zarr": "pipeline/store.py", "dask": "pipeline/scheduling/", "distributed": "pipeline/scheduling/"}


def floor(path: str) -> str:
    """The floor that a file (or a module's path without its suffix) is on."""
    module = path.removesuffix(".py")
    fitting = [place for place in PLACES if module == place or (place.endswith("/") and f"{module}/".startswith(place))]
    assert fitting, f"{path}: expected a file of a room that has a floor, got none; add it to a room"
    return PLACES[max(fitting, key=len)]


def imports(path: str) -> set[str]:
    """Every module a file imports; `from b23d.stages import render` counts as both."""
    found: set[str] = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            inner = [f"{module}.{alias.name}" for alias in node.names]
            found |= {module, *(name for name in inner if (ROOT / f"{name.replace('.', '/')}.py").exists())}
    return found


@pytest.mark.parametrize("path", FILES)
def test_imports_run_one_way(path: str) -> None:
    own = floor(path)
    for name in imports(path):
        root = name.split(".")[0]
        assert root not in PACKAGES, f"{path} imports {name}: write b23d.{name}"
        assert path.startswith(ONLY.get(root, "")), f"{path} imports {name}: only {ONLY[root]} may"
        inner = name.removeprefix("b23d.").replace(".", "/")
        if root != "b23d" or inner.split("/")[0] not in PACKAGES:
            continue
        above = floor(inner)
        assert FLOORS.index(above) <= FLOORS.index(own), f"{path} ({own}) imports {name} ({above}): upwards"
        known = above in ("schemas", "declaration", "science")
        assert own != "science" or known, f"{path} imports {name}: a stage knows the declaration"


def test_no_file_imports_itself_by_way_of_others() -> None:
    """Imports for annotations alone count: what one has to read to understand a file ends somewhere."""
    left = {path.removesuffix(".py").replace("/", "."): imports(path) for path in FILES}
    left = {name: {one.removeprefix("b23d.") for one in found} & left.keys() for name, found in left.items()}
    while ends := {name for name, found in left.items() if not found & left.keys()}:
        left = {name: found for name, found in left.items() if name not in ends}
    assert not left, f"imported in a circle: {sorted(left)}"


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
