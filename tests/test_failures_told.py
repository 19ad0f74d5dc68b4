"""A failed run says each error once, and one line of how much failed and what became of the rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.small_runs import b23d, make_boxes

UNTIL = ("--until", "normalize", "--workers", "0")


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(make_boxes(tmp_path, 2))


def broken(path: str, *names: str) -> None:
    for name in names:
        (Path(path).parent / "shapes" / "box" / name).write_text(
            f"nonsense {name}"
        )  # of the same bytes, one would be tried


@pytest.mark.parametrize("how", [(), ("--quiet",), ("--verbose",)])
def test_each_error_is_said_once(path: str, how: tuple[str, ...]) -> None:
    broken(path, "b8.ply", "b9.ply")
    for _ in range(2):  # as it fails, and as it is tried again
        said = b23d("run", path, *UNTIL, *how, code=1)
        assert said.count("✗") == 2 and said.count("b8.ply: header") == said.count("b9.ply: header") == 1
        assert said.count("2 failed; the rest is done. The next run retries only what failed") == 1


def test_where_all_fails_nothing_is_called_done(path: str) -> None:
    broken(path, "b0.ply", "b1.ply")
    said = b23d("run", path, *UNTIL, code=1)
    assert "2 failed; nothing could be done. " in said and "rest is done" not in said and said.count("✗") == 2


def test_problems_of_the_run_as_a_whole_are_said_once(path: str) -> None:
    """These are no task's, so that nothing tells of them as it ends."""
    for _ in range(2):
        said = b23d("run", path, "--set", "shots.count=9", "--workers", "0", code=1)
        assert said.count("expected 9 annotated shapes") == 1
        assert "1 failed; the rest is done" in said and "nothing could be done" not in said


def test_a_traceback_follows_its_error(path: str) -> None:
    broken(path, "b9.ply")
    said = b23d("--debug", "run", path, *UNTIL, code=1)
    assert "Traceback" in said and said.count("✗") == 1
    b23d("params", "shots")  # sets --debug back
