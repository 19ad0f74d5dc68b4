"""The store: what zarr itself reads, what damage it finds, and that half an artifact is never there."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from b23d.pipeline.errors import ArtifactNotFoundError, CorruptArtifactError, StoreError
from b23d.pipeline.storage.zarr_format import decode, encode
from b23d.pipeline.store import Store
from tests.toy import Numbers

ADDRESS = "ab" + "0" * 62
DTYPES = st.sampled_from(["uint8", "int32", "float16", "float32", "float64", "bool"])


@pytest.fixture(params=["path", "url"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    if request.param == "path":
        return Store(tmp_path / "store")
    return Store(f"memory://{tmp_path.name}-{request.node.name}")


def numbers(n: int = 5) -> Numbers:
    rng = np.random.default_rng(0)
    return Numbers(values=rng.normal(size=n), grid=rng.normal(size=(3, n)).astype(np.float32), note="σ")


def test_what_is_written_is_read(store: Store) -> None:
    assert not store.has("square", ADDRESS) and store.addresses("square") == set()
    size, content = store.write("square", ADDRESS, numbers(), {"seconds": 1})
    found = store.read("square", ADDRESS, Numbers)
    assert store.has("square", ADDRESS) and store.addresses("square") == {ADDRESS} and store.stages() == ["square"]
    assert found.note == "σ" and found.grid is not None
    np.testing.assert_array_equal(found.values, numbers().values)
    np.testing.assert_array_equal(found.grid, numbers().grid)
    head = store.head("square", ADDRESS)
    assert head.provenance == {"seconds": 1} and 0 < head.stored_bytes < size and head.content == content


def test_absent_optional_arrays_stay_absent(store: Store) -> None:
    store.write("square", ADDRESS, Numbers(values=np.zeros(2)), {})
    assert store.read("square", ADDRESS, Numbers).grid is None


@settings(max_examples=60, deadline=None)
@given(st.data(), st.booleans())
def test_the_format_is_zarrs(data: st.DataObject, sharded: bool) -> None:
    """zarr reads every array we write, and our reader reads its own bytes back."""
    from zarr.storage import MemoryStore

    from b23d.pipeline.storage.zarr_format import array_metadata, chunk_key

    shapes = hnp.array_shapes(min_dims=2 if sharded else 0, max_dims=4, min_side=1 if sharded else 0, max_side=5)
    array = data.draw(hnp.arrays(data.draw(DTYPES), data.draw(shapes)))
    encoded = encode(array, sharded)
    np.testing.assert_array_equal(decode(encoded, array.shape, array.dtype.name, sharded), array)
    import json

    from zarr.core.buffer import cpu

    files = {
        "zarr.json": json.dumps(array_metadata(array.shape, array.dtype, sharded)).encode(),
        chunk_key(array.shape): encoded,
    }
    memory = MemoryStore({key: cpu.Buffer.from_bytes(value) for key, value in files.items()})
    read = np.asarray(zarr.open_array(memory, mode="r")[...])
    assert read.dtype == array.dtype
    np.testing.assert_array_equal(read, array)


def test_zarr_opens_an_artifact(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write("square", ADDRESS, numbers(), {})
    group = zarr.open_group(store.path("square", ADDRESS), mode="r")
    assert sorted(group.array_keys()) == ["grid", "values"] and group["grid"].shards == (3, 5)  # type: ignore[union-attr]
    np.testing.assert_array_equal(group["values"][...], numbers().values)  # type: ignore[index]


def chunk(store: Store, name: str) -> Path:
    return next(
        path
        for path in Path(store.path("square", ADDRESS), name).rglob("*")
        if path.is_file() and path.name != "zarr.json"
    )


@pytest.mark.parametrize("name", ["values", "grid"])
@pytest.mark.parametrize("damage", ["flip", "truncate", "remove"])
def test_damage_is_found_on_reading_and_by_verify(tmp_path: Path, name: str, damage: str) -> None:
    store = Store(tmp_path)
    store.write("square", ADDRESS, numbers(1000), {})
    assert store.damage("square", ADDRESS) == []
    path = chunk(store, name)
    data = bytearray(path.read_bytes())
    if damage == "flip":
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    elif damage == "truncate":
        path.write_bytes(data[: len(data) // 2])
    else:
        path.unlink()
    with pytest.raises(CorruptArtifactError, match=name):
        getattr(store.read("square", ADDRESS, Numbers), name)
    assert any(name in line for line in store.damage("square", ADDRESS))


def test_damaged_head_is_found(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.write("square", ADDRESS, numbers(), {})
    Path(store.path("square", ADDRESS), "zarr.json").write_text("{")
    with pytest.raises(CorruptArtifactError):
        store.read("square", ADDRESS, Numbers)
    assert store.damage("square", ADDRESS)


def test_nothing_there_says_so(store: Store) -> None:
    with pytest.raises(ArtifactNotFoundError, match="run it first"):
        store.read("square", ADDRESS, Numbers)


def test_a_writer_that_dies_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted before the rename: not there. A rival that was faster: its copy stays."""
    store = Store(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", lambda self, target: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            store.write("square", ADDRESS, numbers(), {})
    assert store.addresses("square") == set() and not list((tmp_path / ".writing").iterdir())
    store.write("square", ADDRESS, numbers(), {"by": "first"})
    store.write("square", ADDRESS, numbers(), {"by": "second"})
    assert store.head("square", ADDRESS).provenance == {"by": "first"}


def test_a_broken_folder_is_replaced(tmp_path: Path) -> None:
    store = Store(tmp_path)
    Path(store.path("square", ADDRESS), "values").mkdir(parents=True)
    store.write("square", ADDRESS, numbers(), {})
    assert store.damage("square", ADDRESS) == []


def test_delete(store: Store) -> None:
    store.write("square", ADDRESS, numbers(), {})
    store.delete("square", ADDRESS)
    assert not store.has("square", ADDRESS)


def test_a_store_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="store: expected a folder"):
        Store(tmp_path / "file" / "store").check_writable()


def test_sweep_keeps_what_is_young(tmp_path: Path) -> None:
    store = Store(tmp_path)
    (tmp_path / ".writing" / "x").mkdir(parents=True)
    store.drop_leftovers()
    assert (tmp_path / ".writing" / "x").exists()
    store.drop_leftovers(older_than=-1)
    assert not (tmp_path / ".writing" / "x").exists()
    shutil.rmtree(tmp_path)
