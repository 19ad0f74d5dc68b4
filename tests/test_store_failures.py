"""A store that fails stops a run once; a shape that failed once is done with all that waits behind it."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from b23d.pipeline.cli import main
from b23d.pipeline.errors import MissingPackageError, NotAStoreError, StoreError
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.tasks import Outcome
from b23d.pipeline.stage import STAGES
from b23d.pipeline.storage import filesystem
from b23d.pipeline.store import Store
from tests.toy import Numbers, make_toy

Write = Callable[[Path, bytes], int]


def failing(monkeypatch: pytest.MonkeyPatch, number: int, after: int) -> list[str]:
    """Writing artifacts fails with an errno after so many files; returns the list of refused ones."""
    written, refused = [0], []
    write: Write = Path.write_bytes

    def write_bytes(self: Path, data: bytes) -> int:
        if ".writing" in self.parts:
            written[0] += 1
            if written[0] > after:
                refused.append(self.name)
                raise OSError(number, os.strerror(number), str(self))
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    return refused


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EIO, errno.ESTALE, errno.EACCES])
@pytest.mark.parametrize("after", [0, 25])
def test_a_failing_disk_stops_the_run_at_once_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, after: int
) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    with monkeypatch.context() as patch:
        refused = failing(patch, number, after)
        with pytest.raises(StoreError, match="run again to go on") as caught:
            run.execute(workers=0)
    assert len(refused) == 1 and os.strerror(number) in str(caught.value), "found by one shape, not by each in turn"
    assert "toy/" not in str(caught.value), "it is no shape's fault"
    assert run.index.quarantined() == {} and not list((tmp_path / "store" / ".writing").iterdir())
    before = run.plan().count()["square"][State.CACHED]
    report = Run.load(path).execute(workers=0)
    assert report.ok and sum(outcome.stage == "square" for outcome in report.done) == 6 - before


def test_the_command_says_it_once_and_exits_with_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    path = make_toy(tmp_path)
    failing(monkeypatch, errno.ENOSPC, 10)
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path), "--workers", "0"])
    told = capfd.readouterr()
    assert ended.value.code == 3 and (told.out + told.err).count("No space left") == 1


def test_a_store_that_cannot_be_written_is_an_exit_with_3(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = make_toy(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as ended:
        main(["run", str(path), "--store", str(tmp_path / "file" / "store")])
    assert ended.value.code == 3 and "--store" in capfd.readouterr().err


@pytest.mark.parametrize("error", [FileNotFoundError("The specified bucket does not exist"), RuntimeError("endpoint")])
def test_a_lost_bucket_stops_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    """Object stores raise kinds of their own."""
    from fsspec.implementations.memory import MemoryFileSystem

    path = make_toy(tmp_path)
    url = f"memory://{tmp_path.name}"
    pipe, written = MemoryFileSystem.pipe_file, [0]

    def pipe_file(self: MemoryFileSystem, path: str, value: bytes, **options: object) -> object:
        written[0] += 1
        if written[0] > 30:
            raise error
        return pipe(self, path, value, **options)

    with monkeypatch.context() as patch:
        patch.setattr(MemoryFileSystem, "pipe_file", pipe_file)
        with pytest.raises(StoreError, match="run again"):
            Run.load(path, store=url).execute(workers=0)
    run = Run.load(path, store=url)
    assert run.index.quarantined() == {} and run.execute(workers=0).ok


def test_a_store_that_is_taken_away_is_not_begun_anew(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    store = tmp_path / "store"

    def unmount(_: object, what: object) -> None:
        if isinstance(what, Outcome) and store.exists():
            store.rename(tmp_path / "away")

    with pytest.raises(StoreError):
        Run.load(path).execute(workers=0, watch=unmount)
    assert len(list((tmp_path / "away").rglob("zarr.json"))) >= 3


@pytest.fixture
def flaky(monkeypatch: pytest.MonkeyPatch) -> Iterator[set[float]]:
    """`square` fails, as a machine does, for numbers that begin with one of these."""
    broken: set[float] = set()
    square = STAGES["square"]

    def function(numbers: Numbers, params: object) -> object:
        if float(numbers.values[0]) in broken:
            raise OSError(errno.EAGAIN, "try again later")
        return square.function(numbers, params=params)

    monkeypatch.setitem(STAGES, "square", replace(square, function=function))
    yield broken


def test_what_failed_once_is_done_by_the_next_run_with_all_that_waited(tmp_path: Path, flaky: set[float]) -> None:
    path = make_toy(tmp_path)
    flaky |= {0.0, 1.0, 2.0}
    first = Run.load(path).execute(workers=0)
    assert not first.ok and len(first.failures) == 3 and first.blocked > 0
    flaky.clear()
    second = Run.load(path).execute(workers=0)
    assert second.ok and Run.load(path).plan().to_run() == [] and second.blocked == 0
    assert len(first.done) + len(second.done) == 20


def test_what_still_fails_is_tried_once_a_run_and_said(tmp_path: Path, flaky: set[float]) -> None:
    path = make_toy(tmp_path)
    flaky |= {1.0}
    for _ in range(2):
        report = Run.load(path).execute(workers=0)
        assert not report.ok and len(report.failures) == 1 and report.blocked > 0
    flaky.clear()
    assert Run.load(path).execute(workers=0).ok


@pytest.mark.parametrize(("url", "extra"), [("s3://bucket/x", "s3"), ("gs://bucket", "gcs"), ("az://box/x", "azure")])
def test_a_missing_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, url: str, extra: str, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("s3fs", "gcsfs", "adlfs"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingPackageError, match=rf"pip install 'b23d\[{extra}\]'"):
        Store(url)
    for command in (["plan", str(make_toy(tmp_path))], ["run", str(make_toy(tmp_path))]):
        with pytest.raises(SystemExit) as ended:
            main([*command, "--store", url])
        assert ended.value.code == 2 and f"b23d[{extra}]" in capfd.readouterr().err


def test_the_extras_exist() -> None:
    import tomllib

    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert set(filesystem.EXTRAS.values()) <= project["optional-dependencies"].keys()


def test_an_unknown_protocol_is_said() -> None:
    with pytest.raises(NotAStoreError, match="known protocol"):
        Store("zzz://somewhere")


def test_a_table_over_fewer_targets_says_so(tmp_path: Path, flaky: set[float]) -> None:
    from b23d.stages.workbench.results.scores import coverage

    path = make_toy(tmp_path)
    run = Run.load(path)
    shots = {shot.id for draw in run.plan().draws for shot in draw.shots}
    target = next(shape.id for shape in run.shapes if shape.id not in shots)
    flaky.add(float(target[1:]))
    run.execute(workers=0)
    wanted = len({shape for stage, shape, _ in run.plan().by_shape if stage == "add"})
    assert coverage(Run.load(path), "add") == f"{wanted - 1} of {wanted} targets"
    flaky.clear()
    Run.load(path).execute(workers=0)
    assert coverage(Run.load(path), "add") == ""


def test_an_object_store_that_cannot_be_read_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Without credentials, say: errors of their own kinds, at the first look."""
    from fsspec.implementations.memory import MemoryFileSystem

    def refuse(*_: object, **__: object) -> None:
        raise Exception("unable to locate credentials")

    for name in ("cat_file", "find", "ls", "exists", "pipe_file", "makedirs"):
        monkeypatch.setattr(MemoryFileSystem, name, refuse)
    for command in ("plan", "run"):
        with pytest.raises(SystemExit) as ended:
            main([command, str(make_toy(tmp_path)), "--store", f"memory://{tmp_path.name}"])
        assert ended.value.code == 3 and "credentials" in capfd.readouterr().err
