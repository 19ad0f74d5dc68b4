"""A store in S3 (moto's server, on loopback): nothing is ever seen half, whoever writes, reads or fails when."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
from tests.toy import Numbers, make_toy

pytest.importorskip("s3fs", reason="needs s3fs: pip install 'b23d[s3]'")
server = pytest.importorskip("moto.server", reason="needs moto and flask: pip install 'b23d[dev]'")

ADDRESS = "ab" * 32


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """URL of an empty bucket; what reaches it is in the environment, which workers inherit."""
    import s3fs

    running = server.ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():
            patch.setenv(name, value)
        s3fs.S3FileSystem.clear_instance_cache()
        s3fs.S3FileSystem().mkdir("b23d-test")
        yield "s3://b23d-test"
        s3fs.S3FileSystem.clear_instance_cache()
    running.stop()


def artifact(seed: int = 0) -> Numbers:
    numbers = np.random.default_rng(seed).random((3, 50))
    return Numbers(values=numbers[0], grid=numbers.astype(np.float32), note="é")


@pytest.mark.parametrize("workers", [0, 2])
def test_a_run_stores_and_resumes_there(bucket: str, tmp_path: Path, workers: int) -> None:
    path = make_toy(tmp_path)
    url = f"{bucket}/run-{workers}"
    run = Run.load(path, store=url)
    report = run.execute(workers=workers)
    assert report.ok and len(report.done) == 20
    assert Run.load(path, store=url).execute(workers=0).done == []
    here = Run.load(path)
    here.execute(workers=0)
    for (shape, draw, there), (_, _, local) in zip(run.collect("add"), here.collect("add"), strict=True):
        assert isinstance(there, Numbers) and isinstance(local, Numbers)
        np.testing.assert_array_equal(there.values, local.values, err_msg=f"{shape.name}, draw {draw}")


def test_whatever_write_fails_nothing_is_seen_and_the_next_writer_mends_it(
    bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The object that says complete is the last of all."""
    store, names = Store(f"{bucket}/commit"), list[str]()
    real = store.fs.pipe_file

    def counted(path: str, data: bytes, **options: Any) -> Any:
        names.append(path)
        return real(path, data, **options)

    monkeypatch.setattr(store.fs, "pipe_file", counted)
    store.write("square", ADDRESS, artifact(), {})
    assert names[-1].endswith(f"{ADDRESS[2:]}/zarr.json") and len(names) >= 4
    for failing in range(len(names)):
        one, left = f"{failing:02x}" * 32, [failing]

        def fails(path: str, data: bytes, left: list[int] = left, **options: Any) -> Any:
            if not left[0]:
                raise OSError("the connection was lost")
            left[0] -= 1
            return real(path, data, **options)

        monkeypatch.setattr(store.fs, "pipe_file", fails)
        with pytest.raises(OSError):
            store.write("square", one, artifact(), {})
        assert not store.has("square", one) and one not in store.addresses("square")
        monkeypatch.setattr(store.fs, "pipe_file", real)
        store.write("square", one, artifact(), {})
        assert store.has("square", one) and not store.damage("square", one)


def test_two_writers_race_and_a_reader_never_sees_half(bucket: str) -> None:
    wanted, problems, ended = artifact(), list[str](), threading.Event()
    addresses = [f"{i:064x}" for i in range(25)]
    start = threading.Barrier(3)

    def write() -> None:
        store = Store(f"{bucket}/race")
        start.wait()
        for address in addresses:
            store.write("square", address, artifact(), {})

    def read() -> None:
        store = Store(f"{bucket}/race")
        start.wait()
        while not ended.is_set():
            for address in addresses:
                if store.has("square", address):
                    try:
                        found = store.read("square", address, Numbers)
                        np.testing.assert_array_equal(found.values, wanted.values)
                        np.testing.assert_array_equal(found.grid, wanted.grid)  # type: ignore[arg-type]
                    except Exception as error:
                        problems.append(f"{address[-4:]}: {type(error).__name__}: {error}")

    writers, reader = [threading.Thread(target=write) for _ in range(2)], threading.Thread(target=read)
    for thread in (*writers, reader):
        thread.start()
    for thread in writers:
        thread.join()
    ended.set()
    reader.join()
    store = Store(f"{bucket}/race")
    assert not problems and store.addresses("square") == set(addresses)
    assert not any(store.damage("square", address) for address in addresses)


def test_what_another_has_written_is_seen_at_once(bucket: str) -> None:
    """No listing is kept from before."""
    one, other = Store(f"{bucket}/fresh"), Store(f"{bucket}/fresh")
    assert one.addresses("square") == set()
    other.write("square", ADDRESS, artifact(), {})
    assert one.addresses("square") == {ADDRESS} and one.stages() == ["square"]
    other.delete("square", ADDRESS)
    assert one.addresses("square") == set() and not one.has("square", ADDRESS)
