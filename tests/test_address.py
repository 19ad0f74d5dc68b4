"""Addresses: frozen by golden digests, the same in every process, sensitive to all that matters and nothing else."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from b23d.pipeline.address import RECIPE, StageAddress, canonical_json, leaf_address, sha256

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)


def test_golden_digests_freeze_the_recipe() -> None:
    """If this fails, every stored artifact of every user is lost to them: raise RECIPE, and say so in the release
    notes."""
    assert RECIPE == 1
    assert (
        leaf_address({"a": 1}, {"mesh.ply": "00ff"})
        == "730c4715b193a59fc7a41d0b39b19762ab7036384c11f4dd7d371ef1a0f201c8"
    )
    render = StageAddress("render", 1, {"rings": 5, "texture": False})
    assert (
        render({"normalize": "aa", "shot_x": ["b", "c"]})
        == "51e0e2d4e83dd1d6dc656a44db347a5bf71758b47f4e63b3de708a7df506dc48"
    )


HEX = st.text("0123456789abcdef", min_size=1, max_size=8)


@given(
    JSON,
    st.dictionaries(st.text("abcz_", min_size=1, max_size=4), HEX | st.lists(HEX, min_size=1, max_size=3), max_size=4),
)
def test_stage_address_is_the_documented_formula(params: object, inputs: dict[str, str | list[str]]) -> None:
    whole = {"recipe": RECIPE, "stage": "s", "version": 3, "params": {"p": params}, "inputs": inputs}
    assert StageAddress("s", 3, {"p": params})(inputs) == sha256(canonical_json(whole))


@given(st.dictionaries(st.text(max_size=5), JSON, max_size=5))
def test_key_order_does_not_matter(table: dict[str, object]) -> None:
    assert canonical_json(table) == canonical_json(dict(reversed(list(table.items()))))


def test_every_part_matters() -> None:
    base = StageAddress("s", 1, {"a": 1})({"x": "1"})
    others = [
        StageAddress("t", 1, {"a": 1})({"x": "1"}),
        StageAddress("s", 2, {"a": 1})({"x": "1"}),
        StageAddress("s", 1, {"a": 2})({"x": "1"}),
        StageAddress("s", 1, {"a": 1})({"x": "2"}),
        StageAddress("s", 1, {"a": 1})({"y": "1"}),
        StageAddress("s", 1, {"a": 1})({"x": ["1"]}),
    ]
    assert len({base, *others}) == 7


def test_nan_is_refused() -> None:
    with pytest.raises(ValueError):
        canonical_json({"sigma": math.nan})


def test_another_process_gives_the_same_address() -> None:
    code = (
        "from b23d.pipeline.address import StageAddress; "
        "print(StageAddress('s', 1, {'b': 0.1, 'a': [1, 'ü']})({'x': 'y'}))"
    )
    outputs = [
        subprocess.run(
            [sys.executable, "-c", code], env={"PYTHONHASHSEED": seed}, capture_output=True, text=True, check=True
        ).stdout
        for seed in ("0", "1")
    ]
    found = set(outputs)
    assert found == {StageAddress("s", 1, {"b": 0.1, "a": [1, "ü"]})({"x": "y"}) + "\n"}
