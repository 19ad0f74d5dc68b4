"""What a store serves is what was written there: heads, chunks, metadata, places. And old heads are still read."""

from __future__ import annotations

import json
import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.errors import CorruptArtifactError
from b23d.pipeline.inspection.upkeep import verify
from b23d.pipeline.run import Run
from b23d.pipeline.store import HEAD, Store
from tests.flipping import flips, served_wrongly, unnoticed_by_verify
from tests.toy import Numbers, make_toy

ONE, OTHER = "ab" + "0" * 62, "cd" + "1" * 62


def put(store: Store, address: str, value: float) -> None:
    numbers = Numbers(values=np.full(9, value), grid=np.full((2, 9), value, np.float32), note=f"{value}")
    store.write("square", address, numbers, {"seconds": value})


def test_no_flipped_bit_is_served_or_passed(tmp_path: Path) -> None:
    """Every bit of the head and of a small artifact's other files, a sample of them here; tests/attacks/ tries more."""
    store = Store(tmp_path)
    put(store, ONE, 2.5)
    files = [path for path in Path(store.path("square", ONE)).rglob("*") if path.is_file()]
    assert {path.name for path in files} >= {HEAD, "0"} and len(files) == 5
    for path, data in flips(files, 400, random.Random(0)):
        whole = path.read_bytes()
        path.write_bytes(data)
        assert not served_wrongly(store, "square", ONE, Numbers, path)
        assert not unnoticed_by_verify(store, "square", ONE)
        path.write_bytes(whole)
    assert store.damage("square", ONE) == []


def test_two_swapped_artifacts_are_found_on_reading_and_by_verify(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    one, two = (Path(run.store.path("shift", run.node(f"toy/s{i}", "shift").address)) for i in (1, 2))
    one.rename(tmp_path / "aside")
    two.rename(one)
    (tmp_path / "aside").rename(two)
    with pytest.raises(CorruptArtifactError, match="shift"):
        Run.load(path).artifact("toy/s1", "shift")
    assert {damage.shapes for damage in verify(Run.load(path))} == {("toy/s1",), ("toy/s2",)}
    assert {outcome.shape for outcome in Run.load(path).execute(workers=0).done} == {"toy/s1", "toy/s2"}


def test_an_artifact_of_another_stage_or_of_another_address_is_not_served(tmp_path: Path) -> None:
    store = Store(tmp_path)
    put(store, ONE, 1.0)
    for stage, address in (("shift", ONE), ("square", OTHER)):
        shutil.copytree(store.path("square", ONE), store.path(stage, address))
        with pytest.raises(CorruptArtifactError, match="expected"):
            store.read(stage, address, Numbers)
        assert store.damage(stage, address)


def as_old(store: Store, stage: str, address: str) -> None:
    """Make a head what it was before heads had digests."""
    path = Path(store.path(stage, address), HEAD)
    group = json.loads(path.read_bytes())
    for name in ("head_sha256", "stage", "address", "key", "content"):
        del group["attributes"][name]
    path.write_text(json.dumps(group))


def test_old_heads_are_read_and_mean_the_same(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    node = run.node("toy/s1", "shift")
    content = run.store.head("shift", node.address).content
    as_old(run.store, "shift", node.address)
    head = run.store.head("shift", node.address)
    assert head.content == content and head.key is None
    assert run.store.damage("shift", node.address) == [] and Run.load(path).plan().to_run() == []
    other = Path(run.store.path("shift", run.node("toy/s2", "shift").address))
    shutil.rmtree(other)
    shutil.copytree(run.store.path("shift", node.address), other)
    assert run.store.damage("shift", run.node("toy/s2", "shift").address), "its provenance says where it belongs"


def test_a_head_that_is_no_head_is_said_to_be_damaged(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for text in ("", "{", "[]", "null", "1", '{"attributes": 3}', '{"attributes": {}}', "[" * 100_000, "\x00" * 40):
        put(store, ONE, 1.0)
        Path(store.path("square", ONE), HEAD).write_text(text)
        with pytest.raises(CorruptArtifactError):
            store.read("square", ONE, Numbers)
        assert len(store.damage("square", ONE)) == 1
        store.delete("square", ONE)


def test_what_is_written_over_something_broken_is_whole(tmp_path: Path) -> None:
    store = Store(tmp_path)
    final = Path(store.path("square", ONE))
    for break_it in (
        lambda: final.joinpath(HEAD).write_text("{"),
        lambda: final.joinpath(HEAD).unlink(),
        lambda: (shutil.rmtree(final), final.write_text("a file")),
        lambda: (final.unlink() if final.is_file() else shutil.rmtree(final), final.mkdir()),
    ):
        put(store, ONE, 1.0)
        break_it()
        put(store, ONE, 1.0)
        assert store.damage("square", ONE) == [] and store.addresses("square") == {ONE}
    assert not list((tmp_path / ".writing").iterdir())


def test_a_damaged_input_is_made_again_by_the_run_that_meets_it(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    for name, damage in (
        ("square", lambda folder: folder.joinpath(HEAD).write_text("{")),
        ("square", lambda folder: next(folder.glob("values/c/*")).write_bytes(b"?")),
        ("square", lambda folder: next(folder.glob("values/c/*")).unlink()),
    ):
        by = random.random()
        damage(Path(run.store.path(name, run.node("toy/s3", name).address)))
        report = Run.load(path, [f"stages.shift.by={by}"]).execute(workers=0)
        assert report.ok and not report.failures
        assert [o.shape for o in report.done if o.stage == "square"] == ["toy/s3"]
        assert sum(o.stage == "shift" for o in report.done) == 6
    assert list(verify(Run.load(path))) == []
