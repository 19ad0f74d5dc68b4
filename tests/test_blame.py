"""A message names what is at fault: once, by a name that the user knows, and nothing that the user never wrote."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import b23d
from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.dataset import Leaf
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.tasks import Task
from b23d.pipeline.scheduling.worker import _naming
from b23d.pipeline.storage.index import Index
from b23d.schemas.params import Params
from b23d.stages.datasets.survey import survey
from b23d.stages.solvers.hungarian import hungarian
from tests.small_runs import make_boxes
from tests.test_solvers import random_problem

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
REFUSED = "expected to read {name}, got Permission denied; give it back its permissions"


def refuse(monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    """Files that end so can be listed, and not read; whoever runs the tests."""
    read, digest = Path.read_bytes, Index.file_digest

    def refusing(path: Path) -> None:
        if path.name.endswith(ending):
            raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "read_bytes", lambda path: refusing(path) or read(path))
    monkeypatch.setattr(Index, "file_digest", lambda index, path: refusing(path) or digest(index, path))


def test_a_file_that_cannot_be_read_is_named_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_boxes(tmp_path, count=2)
    (shape,) = [shape for shape in Run.load(path).shapes if shape.id.endswith("1")]
    (file,) = shape.leaves["source"].files.values()
    refuse(monkeypatch, file.name)
    told = [problem.error for problem in Run.load(path).plan().problems if problem.shape == shape.name]
    assert told == [f"PermissionError: {shape.name}: {REFUSED.format(name=file.name)}"]
    with pytest.raises(PermissionError, match=f"^{REFUSED.format(name=file.name)}$"):
        shape.leaves["source"].read()
    problems = survey(tmp_path / "shapes").problems
    assert problems == [f"{shape.name}: {REFUSED.format(name=file.name)}"]


@pytest.mark.parametrize(("error", "end"), [(FileNotFoundError, "restore it"), (OSError, "restore it, or try again")])
def test_what_the_system_says_keeps_its_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[OSError], end: str
) -> None:
    def fail(path: Path) -> bytes:
        raise error(5, "Input/output error", str(path))

    monkeypatch.setattr(Path, "read_bytes", fail)
    leaf = Leaf(lambda files, values: None, files={"mesh.obj": tmp_path / "a.obj"})  # type: ignore[arg-type,return-value]
    with pytest.raises(error, match=f"^expected to read a.obj, got Input/output error; {end}$"):
        leaf.read()


@pytest.mark.parametrize("text", ["garbage", ""])
def test_a_bad_shape_of_match_is_named_once(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.obj").write_text(text)
    (tmp_path / "good.obj").write_text(OBJ)
    with pytest.raises(RuntimeError) as error:
        b23d.match(tmp_path / "bad.obj", tmp_path / "good.obj", store=str(tmp_path / "store"))
    assert str(error.value).startswith(f"ValueError: {tmp_path / 'bad.obj'}: expected ")
    assert len(re.findall(r"bad\.obj", str(error.value))) == 1 and "given/" not in str(error.value)


def test_messages_of_match_name_the_readers_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plug_in()
    for folder in ("old", "new"):
        (tmp_path / folder).mkdir()
    (tmp_path / "old" / "t.obj").write_text(OBJ + "f 1 2 99\n")
    (tmp_path / "new" / "t.obj").write_text(OBJ)
    (tmp_path / "line.xyz").write_text("".join(f"{x} 0 0\n" for x in range(40)))
    few = ["--set", "stages.normalize.count=64", "--set", "stages.render.rings.count=1"]
    for files in (["old/t.obj", "new/t.obj"], ["new/t.obj", "old/t.obj"]):
        said = str(CliRunner().invoke(app, ["match", *files, *few]).exception)
        assert said.startswith("ValueError: old/t.obj: line ") and "given" not in said and said.count("t.obj") == 1
    said = str(CliRunner().invoke(app, ["match", "new/t.obj", "line.xyz", "--method", "smooth", *few]).exception)
    assert "line.xyz: " in said and "second shape" not in said and "given" not in said
    with pytest.raises(RuntimeError, match=r"^ValueError: b: expected at least 2 distinct points"):
        b23d.match(tmp_path / "new" / "t.obj", np.zeros((5, 3)), store="store")


def test_options_of_match_are_named_and_no_run_file_that_nobody_wrote(tmp_path: Path) -> None:
    for name in ("a.obj", "b.obj"):
        (tmp_path / name).write_text(OBJ)
    plug_in()
    files = [str(tmp_path / name) for name in ("a.obj", "b.obj")]
    for words, begin in (
        (["--encoder", "nope"], "--encoder nope: expected one of "),
        (["--set", "stages.extract.encoder=nope"], "--set stages.extract.encoder=nope: encoder nope: expected one of "),
        (["--set", "stages.extract.depth=3"], "--set stages.extract.depth=3: expected a known key, got 'depth'"),
    ):
        done = CliRunner().invoke(app, ["match", *files, *words])
        assert isinstance(done.exception, RunFileError), done.output
        assert str(done.exception).startswith(begin) and "given.toml" not in str(done.exception)
    with pytest.raises(RunFileError, match=r"^encoder nope: expected one of "):
        b23d.features(np.zeros((4, 3)), encoder="nope")


def test_too_few_candidates_are_told_of_the_target() -> None:
    with pytest.raises(ValueError, match=r"^the target: expected at least 5 candidates, got 4; "):
        hungarian(random_problem(0, n=4, k=5))


def test_verbs_about_a_store_take_overrides_of_a_run_file(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, count=2)
    elsewhere = tmp_path / "elsewhere"
    Run.load(path, ["outputs=['normalize']", f"store.root={elsewhere}"]).execute(workers=0)
    for verb, said in (("status", "nothing is running over"), ("log", "history of")):
        done = CliRunner().invoke(app, [verb, str(path), "--set", f"store.root={elsewhere}"])
        assert done.exit_code == 0, done.output
        assert f"{said} {elsewhere}" in done.output.replace("\n", "")
        wrong = CliRunner().invoke(app, [verb, "--set", "store.root=x"])
        assert str(wrong.exception) == "--set store.root=x: expected a run file to override, got none; name one"


def test_what_concerns_a_class_and_no_draw_is_told_of_the_class_once() -> None:
    task = Task("stand", "0", "chair/a", "chair", (), ("chair/a",), Params(), {"shot_source": []}, "store")
    assert _naming(task, "nothing tells up") == _naming(task, "class chair: nothing tells up")
    assert _naming(task, "nothing tells up") == "class chair: nothing tells up"
