"""The table of promises names tests that exist, and each row names one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
SEPARATOR = re.compile(r"[-| ]+")


def rows() -> list[tuple[str, str]]:
    """Promise and tests of each row, in the table's words."""
    cells = []
    for line in (TESTS / "PROMISES.md").read_text().splitlines():
        if line.startswith("|") and not SEPARATOR.fullmatch(line) and line != "| promise | test |":
            *_, promise, tests, _ = line.split("|")
            cells.append((promise.strip(), tests))
    return cells


def functions(file: str) -> set[str]:
    """The tests in a file of tests."""
    tree = ast.parse((TESTS / file).read_text())
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def missing(tests: str) -> list[str]:
    """What a row names and is not there: `file.py`, `file.py::test_name`, `test_name` of the file before, `…` for
    the rest of a name, `python -m tests.module`."""
    lost, file = [], ""
    for name in re.findall(r"`([^`]+)`", tests):
        module = re.match(r"python -m tests\.([\w.]+)", name)
        file, _, test = name.partition("::") if ".py" in name else (file, "", name)
        if module:
            there = (TESTS / f"{module[1].replace('.', '/')}.py").is_file()
        elif not (TESTS / file).is_file():
            there = False
        else:
            pattern = re.escape(test).replace("…", ".*")
            there = not test or any(re.fullmatch(pattern, known) for known in functions(file))
        if not there:
            lost.append(name)
    return lost


@pytest.mark.parametrize(("promise", "tests"), rows())
def test_each_promise_names_tests_that_exist(promise: str, tests: str) -> None:
    assert re.search(r"`test_\w+\.py", tests), f"{promise}: name the test that holds it"
    assert not missing(tests), f"{promise}: named, but not there"


def test_what_is_not_there_is_found() -> None:
    assert len(rows()) >= 16
    assert missing("`test_none.py`, `test_promises.py::test_none`, `test_each…`, `python -m tests.none`") == [
        "test_none.py",
        "test_promises.py::test_none",
        "python -m tests.none",
    ]
