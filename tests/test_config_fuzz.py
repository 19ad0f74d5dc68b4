"""Whatever a run file holds, loading it gives a Config or one line a fault, never a traceback."""

from __future__ import annotations

import datetime
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from b23d.pipeline.errors import RunFileError, naming
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import members
from b23d.stages.encoders.weights import find_checkpoint

GOOD: dict[str, Any] = {
    "name": "x",
    "dataset": {"kind": "procedural", "classes": ["mug"], "count": 4},
    "shots": {"count": 3, "draws": [0, 1], "ids": {"mug": ["a"]}, "split": "all-but-shots"},
    "stages": {
        "normalize": {"count": 64},
        "extract": {"encoder": "efficientnet-lite0", "weights": "w"},
        "optimize": {},
    },
    "feeds": {"optimize": "detect"},
    "outputs": ["score"],
    "sweep": {"shots.count": [1, 2]},
    "variants": {"one": {"shots.count": 1}},
    "analysis": {"kind": "stability"},
    "store": {"root": "s", "transient": ["render"]},
    "execution": {"workers": 0, "memory_gb": 1.5, "resources": {"extract": {"gpu": 0.5}}},
}
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=8),
    st.sampled_from(["", "\0", "~nobody/x", "..", "x" * 5000, "folder", "[red]", "{}", "stages", "1e999"]),
    st.just(datetime.date(2026, 1, 1)), st.just(datetime.time(1, 2)),
)  # fmt: skip
TREES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=6), inner, max_size=3)),
    max_leaves=6,
)


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{quoted(key)} = {toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return quoted(value)
    if value is None:
        return "[]"
    return str(value).lower() if isinstance(value, bool | float) else str(value)


def quoted(text: str) -> str:
    kept = (
        c if c.isprintable() and c not in '"\\' and not 0xD800 <= ord(c) < 0xE000 else f"\\U{ord(c):08x}" for c in text
    )
    return '"' + "".join(c if not c.startswith("\\U0000d") else "?" for c in kept) + '"'


def places(table: dict[str, Any], above: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found: list[tuple[str, ...]] = []
    for key, value in table.items():
        found.append((*above, key))
        found += places(value, (*above, key)) if isinstance(value, dict) else []
    return found


def put(table: dict[str, Any], place: tuple[str, ...], value: Any) -> dict[str, Any]:
    head, *rest = place
    return {**table, head: put(table.get(head, {}), tuple(rest), value) if rest else value}


def load(text: str, *overrides: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.toml"
        path.write_text(text, encoding="utf-8")
        try:
            members(load_config(path, overrides))
        except (RunFileError, FileNotFoundError) as error:
            assert str(error).strip() and all(len(line) < 2000 for line in str(error).splitlines())


@settings(max_examples=250, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    place=st.sampled_from([*places(GOOD), ("base",), ("dataset", "root"), ("dataset", "new"), ("new",)]), value=TREES
)
def test_a_value_of_any_type_anywhere(place: tuple[str, ...], value: Any) -> None:
    load("".join(f"{quoted(key)} = {toml(item)}\n" for key, item in put(GOOD, place, value).items()))


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(tree=st.dictionaries(st.sampled_from([*GOOD, "base", "x"]), TREES, max_size=6))
def test_any_tree(tree: dict[str, Any]) -> None:
    load("".join(f"{quoted(key)} = {toml(item)}\n" for key, item in tree.items()))


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(text=st.text(max_size=60), field=st.sampled_from([".".join(place) for place in places(GOOD)]))
def test_any_override(text: str, field: str) -> None:
    good = "".join(f"{quoted(key)} = {toml(item)}\n" for key, item in GOOD.items())
    load(good, f"{field}={text}")
    load(good, text)


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.toml"
        path.write_bytes(data)
        with pytest.raises(RunFileError, match=r"run file .*run\.toml"):
            load_config(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "x"\n[dataset]\nkind = ["a"]', "expected dataset.kind to be one of"),
        ('name = "x"\nbase = 5\n[dataset]\nkind = "folder"', "expected base to be another run file, got 5"),
        ("name = 3\n[dataset]\nkind = 'folder'", "run file .*: name: expected text, got 3"),
        ("name = 'x'\ndataset = 5", "dataset: .*got 5"),
        ("name = 'x'\nx = " + "[" * 5000 + "]" * 5000, "nested too deep"),
        ("name = 'x'\n[dataset]\nkind = 'folder'\nroot = \"a\\u0000b\"", "expected root to be a path"),
        ("name = 'x'\nstore.root = \"a\\u0000b\"\n[dataset]\nkind = 'procedural'", r"\[store\] root: expected a path"),
        (
            "name = 'x'\nstore.root = '~nobody-here/x'\n[dataset]\nkind = 'procedural'",
            r"\[store\] root: expected a path",
        ),
        ("name = 'x'\n[dataset]\nkind = 'folder'\nroot = {a = 1}", "root: .*got"),
        ("name = 'x'\nstages = [1]\n[dataset]\nkind = 'procedural'", "stages: .*got"),
    ],
)
def test_wrong_types_are_told(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "run.toml"
    path.write_text(text)
    with pytest.raises(RunFileError, match=words):
        load_config(path)


def test_a_store_of_the_command_line_that_is_no_path(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("name = 'x'\n[dataset]\nkind = 'procedural'\n")
    for store in ("~nobody-here/x", "a\0b"):
        with pytest.raises(RunFileError, match=r"^store: expected a path or a URL, got "):
            Run.load(path, store=store)


def test_a_base_that_is_no_run_file(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("name = 'x'\nbase = 'base.toml'\n[dataset]\nkind = 'procedural'\n")
    for text in ("dataset = 5", "stages = 3", "\xff"):
        (tmp_path / "base.toml").write_text(text, encoding="latin-1")
        try:
            load_config(path)
        except RunFileError as error:
            assert "base.toml" in str(error) or "run.toml" in str(error)
    (tmp_path / "base.toml").unlink()
    (tmp_path / "base.toml").mkdir()
    with pytest.raises(RunFileError, match=r"base\.toml"):
        load_config(path)


@pytest.mark.parametrize("index", ['{"weight_map": []}', '{"weight_map": {"a": 3}}', '{"weight_map": {"a": ["x"]}}',
                                   "{}", "[]", '{"weight_map": "x"}', '{"weight_map": {}}', "[" * 100_000])  # fmt: skip
def test_an_index_of_weights_that_is_none(tmp_path: Path, index: str) -> None:
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "model.safetensors.index.json").write_text(index)
    with pytest.raises(ValueError, match=r"index\.json: expected"):
        find_checkpoint("dinov2-small", tmp_path)


def test_errors_name_their_shape() -> None:
    assert naming("box/1", "expected 1 mesh").startswith("box/1: ")
    assert naming("box/b1", "box/b10: expected").startswith("box/b1: box/b10")
    assert naming("box/b1", "/data/box/b1.obj: expected").startswith("box/b1: /data")
    for message in ("box/b1: expected", "keypoint 3 of box/b1: expected", "of 'box/b1'"):
        assert naming("box/b1", message) == message
    assert naming("a/[red]x[/]", "a/[red]x[/]: no") == "a/[red]x[/]: no"
