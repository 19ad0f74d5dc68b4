"""Whatever the Python API is given: an error in our words that names the argument, never a library's own."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import b23d
from b23d.pipeline.planning.selection import Selection
from b23d.stages.workbench.api.run import LoadedRun
from tests.small_runs import make_boxes

FEW = ["stages.normalize.count=64", "stages.render.rings.count=1", "stages.render.resolution=32"]
NO_PATHS: tuple[Any, ...] = (None, [], ["a.toml"], {}, 3, 1.5, b"a", object(), "")
CALLS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    "load path": (lambda run, it: b23d.load(it), NO_PATHS),
    "load override": (lambda run, it: b23d.load(run.config.path, it), (3, None, ["a=b"], {}, "", "x")),
    "load store": (lambda run, it: b23d.load(run.config.path, store=it), (3, b"x", "", ["x"], {})),
    "keypoints folder": (lambda run, it: b23d.keypoints(it), NO_PATHS),
    "keypoints shots": (
        lambda run, it: b23d.keypoints(_shapes(run), shots=it, workers=0),
        (0, -1, True, 1.5, "b0", b"b", [3], [], {}, {"x": ["b0"]}, {"box": 3}, {"box": []}, {3: ["b0"]}),
    ),
    "keypoints workers": (lambda run, it: b23d.keypoints(_shapes(run), workers=it), (-1, "x", 1.5, [], True)),
    "features mesh": (lambda run, it: b23d.features(it), (None, [], {}, 3, 1.5, b"a", object(), "", ".")),
    "features points": (
        lambda run, it: b23d.features(np.zeros((9, 3)), points=it),
        (3, "x", [], {}, np.zeros((2, 2)), [[1, 2, np.nan]]),
    ),
    "features overrides": (
        lambda run, it: b23d.features(np.zeros((9, 3)), overrides=it),
        (3, None, "a=b", [3], {"a": 1}, [["a=b"]], ["x"]),
    ),
    "features encoder": (lambda run, it: b23d.features(np.zeros((9, 3)), encoder=it), (3, ["x"], {}, "nope")),
    "features store": (lambda run, it: b23d.features(np.zeros((9, 3)), store=it), (3, [], "")),
    "match b": (lambda run, it: b23d.match(np.eye(3), it), (None, [], {}, 3, "nowhere.ply")),
    "match method": (lambda run, it: b23d.match(np.eye(3), np.eye(3), method=it), (3, None, [], "foo")),
    "artifact shape": (lambda run, it: run.artifact(it, "normalize"), (None, 3, [], "", "nobody")),
    "artifact stage": (lambda run, it: run.artifact("box/b0", it), (None, 3, [], "", "nothing")),
    "artifact draw": (lambda run, it: run.artifact("box/b0", "optimize", it), (3, "x", [])),
    "plot shape": (lambda run, it: run.plot(it), (None, 3, [], "", "nobody")),
    "plot draw": (lambda run, it: run.plot("box/b0", it), (3, "x", [])),
    "collect": (lambda run, it: list(run.collect(it)), (None, 3, [], "", "nothing")),
    "plan": (lambda run, it: run.plan(it), (None, 3, "x", [])),
    "execute selection": (lambda run, it: run.execute(0, selection=it), (None, 3, "x", [])),
    "execute workers": (lambda run, it: run.execute(it), (-1, "x", 1.5, [], True)),
}


def _shapes(run: LoadedRun) -> Path:
    return run.config.path.parent / "shapes"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> LoadedRun:
    return b23d.load(make_boxes(tmp_path_factory.mktemp("api"), 3))


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_argument_is_told_in_our_words(
    run: LoadedRun, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call, wrong = CALLS[name]
    for it in wrong:
        with pytest.raises((TypeError, ValueError, KeyError, FileNotFoundError)) as error:
            call(run, it)
        said = str(error.value.args[0])
        assert re.search(r"^[^\n]*: expected [^\n]*(, got |; )", said), f"{name} {it!r}: {said}"
        assert "os.PathLike" not in said and "object is not" not in said, f"{name} {it!r}: {said}"


def test_right_arguments_pass(run: LoadedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert b23d.load(str(run.config.path), store=tmp_path / "s").store.root == str(tmp_path / "s")  # type: ignore[arg-type]
    assert run.plan(Selection(limit=1)).draws == run.plan().draws
    ball = np.random.default_rng(0).normal(size=(200, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    none = b23d.features(ball, points=np.zeros((0, 3)), overrides=tuple(FEW))
    assert none.shape[0] == 0 and none.shape[1] > 0
