"""Every package that is imported is declared in pyproject.toml and pinned in constraints.txt."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Mapping
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OWN = {"b23d", "tests"}
OUTSIDE = {"ot", "IPython"}
"""Compared with by a benchmark that asks for it; there already where a notebook runs."""


def normal(name: str) -> str:
    """A distribution's name as PyPI compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def named(requirements: list[str]) -> set[str]:
    return {normal(re.match(r"[\w.-]+", text)[0]) for text in requirements}  # type: ignore[index]


def imported(*folders: str) -> dict[str, str]:
    """Top-level package → a file that imports it."""
    found: dict[str, str] = {}
    for folder in folders:
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                names = []
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.module:
                    names = [node.module]
                found |= {name.split(".")[0]: path.relative_to(ROOT).as_posix() for name in names}
    return {name: path for name, path in found.items() if name not in sys.stdlib_module_names | OWN | OUTSIDE}


def undeclared(imports: Mapping[str, str], declared: set[str]) -> list[str]:
    """What none of the declared distributions provides."""
    providers = packages_distributions()
    return [
        f"{path} imports {name}"
        for name, path in imports.items()
        if not declared & {normal(provider) for provider in providers.get(name, [name])}
    ]


def test_what_the_package_imports_is_declared() -> None:
    optional = {name for needs in PROJECT["optional-dependencies"].values() for name in named(needs)}
    declared = named(PROJECT["dependencies"]) | optional - named(PROJECT["optional-dependencies"]["dev"])
    assert undeclared(imported("pipeline", "schemas", "stages"), declared) == []


def test_what_the_tests_import_is_declared() -> None:
    everything = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    assert undeclared(imported("tests"), {name for needs in everything for name in named(needs)}) == []


def test_what_is_declared_is_pinned() -> None:
    pinned = named([line for line in (ROOT / "constraints.txt").read_text().splitlines() if re.match(r"\w", line)])
    extras = PROJECT["optional-dependencies"]
    installed = [PROJECT["dependencies"], extras["dev"], extras["vit"]]  # what `make setup` takes
    assert {name for needs in installed for name in named(needs)} - pinned == set()
