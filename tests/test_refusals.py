"""What is refused is told in our words, of the option, the override or the file that said it."""

from __future__ import annotations

import copy
import pickle
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, Field, ValidationError, field_validator
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import members
from b23d.pipeline.runfile.overrides import Carried, Listed, said
from b23d.schemas.wanted import wanted
from tests.small_runs import make_boxes
from tests.toy import make_toy

FOREIGN = ("value error", "input should be", "valid integer", "unable to parse", "extra inputs", "is not one of")
"""Words of the libraries that check."""


class Everything(BaseModel):
    whole: int = 1
    number: float = Field(1.0, allow_inf_nan=False)
    yes: bool = True
    text: Annotated[str, Field(pattern="^a", min_length=1, max_length=3)] = "a"
    path: Path = Path()
    some: Annotated[list[int], Field(min_length=1, max_length=2)] = [1]
    table: dict[str, int] = {}
    choice: Literal["a", "b", "c"] = "a"
    least: int = Field(1, ge=1)
    more: int = Field(1, gt=0)
    most: int = Field(1, le=1)
    less: int = Field(1, lt=2)
    own: int = 1

    @field_validator("own")
    @classmethod
    def _own(cls, value: int) -> int:
        if value < 0:
            raise ValueError("one of ours")
        return value


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"whole": "x"}, "a whole number"),
        ({"whole": 1.5}, "a whole number"),
        ({"number": []}, "a number"),
        ({"number": float("nan")}, "a finite number"),
        ({"yes": "perhaps"}, "true or false"),
        ({"text": 3}, "text"),
        ({"text": "b"}, "text like ^a"),
        ({"text": "aaaa"}, "text of 3 characters or less"),
        ({"path": 3}, "a path"),
        ({"some": 3}, "a list"),
        ({"some": []}, "1 or more of them"),
        ({"some": [1, 2, 3]}, "2 of them or less"),
        ({"table": 3}, "a table"),
        ({"choice": "d"}, "one of 'a', 'b', 'c'"),
        ({"least": 0}, "1 or more"),
        ({"more": 0}, "more than 0"),
        ({"most": 2}, "1 or less"),
        ({"less": 2}, "less than 2"),
        ({"own": -1}, "one of ours"),
    ],
)
def test_what_was_wanted_is_said_in_our_words(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as error:
        Everything.model_validate(given)
    assert wanted(error.value.errors()[0]) == words


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["match", "a", "b", "--method", "foo"], "expected one of 'nearest', 'consistent', 'smooth', got 'foo'"),
        (["show", "RUN", "b0", "--frame", "foo"], "expected one of 'file', 'unit', got 'foo'"),
        (["run", "RUN", "--limit", "x"], "expected a whole number, got 'x'"),
        (["run", "RUN", "--limit", "0"], "expected 1 or more, got '0'"),
        (["run", "RUN", "--workers", "-1"], "expected 0 or more, got '-1'"),
        (["keypoints", "RUN", "--draw", "x"], "expected a whole number, got 'x'"),
        (["annotate", "RUN", "--port", "99999"], "expected 65535 or less, got '99999'"),
        (["diff", "RUN", "RUN", "--most", "many"], "expected a whole number, got 'many'"),
    ],
)
def test_options_are_refused_in_our_words(words: list[str], said: str) -> None:
    plug_in()
    done = CliRunner().invoke(app, words)
    told = re.sub(r"[\s│]+", " ", done.output)
    assert done.exit_code == 2 and said in told and f"'{words[-2]}'" in told
    assert not any(foreign in told.lower() for foreign in FOREIGN)


OVERRIDES = [
    "stages.optimize.method=foo",
    "stages.optimize.tresh=1",
    "stages.render.rings=3",
    "stages.foo.x=1",
    "stages.score.thresholds=[]",
    "stages.annotation.warn=3",
    "stages.annotation.refuse=0.01",
    "dataset.damage={kind = 'holes', amount = 7}",
    "shots.count=0",
    "shots.cout=1",
    "dataset.kind=x",
    "dataset.up=q",
    "dataset.root=\\u0000",
    "outputs=3",
    'outputs=["foo"]',
    "feeds.backproject=foo",
    "feeds.backproject=render",
    "feeds.normalize=optimize",
    'store.transient=["foo"]',
    "execution.memory_gb=0",
    "name=/",
]


@pytest.mark.parametrize("override", OVERRIDES)
def test_an_override_is_blamed_by_itself(tmp_path: Path, override: str) -> None:
    override = override.replace("\\u0000", "\0")
    path = make_boxes(tmp_path, 2)
    with pytest.raises(RunFileError) as error:
        load_config(path, ["stages.reweight.sigma=0.02", override])
    assert str(error.value).startswith(f"--set {override}: ") and "run file" not in str(error.value)
    assert not any(foreign in str(error.value).lower() for foreign in FOREIGN)


def test_the_file_is_blamed_for_what_stands_in_it(tmp_path: Path) -> None:
    path = make_toy(tmp_path, extra="[stages.square]\npower = 'wide'\n")
    for overrides in ([], ["stages.shift.by=2"]):
        with pytest.raises(RunFileError, match=r"^run file .*toy.toml: \[stages.square\]: power: expected a number"):
            load_config(path, overrides)
    load_config(path, ["stages.square.power=2"])
    with pytest.raises(RunFileError, match=r"^--set stages.square.power=x: power: expected a number, got 'x'"):
        load_config(path, ["stages.square.power=2", "stages.square.power=x"])


LISTED = [
    ("[sweep]\n'stages.square.power' = ['wide']\n", r'\[sweep\]: stages.square.power="wide": power: expected a number'),
    ("[sweep]\n'stages.square.pwoer' = [1]\n", r"\[sweep\]: stages.square.pwoer=1: expected a known key"),
    ("[sweep]\n'name.first' = [1]\n", r"\[sweep\]: name.first=1: expected name to be a table, got 'toy'"),
    ("[sweep]\n'' = [1]\n", r"\[sweep\]: expected a.b=value, got '=1'"),
    (
        "[variants.'a/b']\n'outputs' = ['squares']\n",
        r"\[variants.a/b\]: outputs=\[\"squares\"\]: outputs: expected a stage",
    ),
    ("[variants.a]\n'store.root' = \"\\u0000\"\n", r'\[variants.a\]: store.root="\\u0000": expected a path'),
    ("[variants.a]\n'feeds.square' = 'x'\n", r'\[variants.a\]: feeds.square="x": feeds.square: expected a stage'),
]


@pytest.mark.parametrize(("table", "said"), LISTED)
def test_the_file_is_blamed_for_what_its_series_set(tmp_path: Path, table: str, said: str) -> None:
    """By the table that lists it, and the entry; what was given besides is blamed no more."""
    path = make_toy(tmp_path, extra=table)
    (member,) = members(load_config(path, [Carried("stages.shift.by=2")]))
    with pytest.raises(RunFileError) as error:
        load_config(path, member.overrides)
    assert re.match(f"run file {re.escape(str(path))}: {said}", str(error.value)), error.value
    assert "--set" not in str(error.value)


def test_a_series_given_by_an_override_is_blamed_on_it(tmp_path: Path) -> None:
    given = 'sweep={"stages.square.power" = ["wide"]}'
    (member,) = members(load_config(path := make_toy(tmp_path), [given]))
    with pytest.raises(
        RunFileError, match=rf"^--set {re.escape(given)}: stages.square.power=\"wide\": power: expected a"
    ):
        load_config(path, member.overrides)


def test_an_unused_option_of_a_variant_is_said_of_the_variant(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 2, "[variants.a]\n'stages.optimize.discrete.starts' = 3\n")
    (member,) = members(load_config(path))
    with pytest.raises(
        RunFileError, match=r"\[variants.a\]: stages.*; set stages.optimize.method=discrete there, too$"
    ):
        load_config(path, member.overrides)


def test_where_an_override_was_said_goes_where_it_goes() -> None:
    """To a worker, or a copy."""
    one = Listed("a.b=1", "run file x.toml: [sweep]")
    assert said(pickle.loads(pickle.dumps(one))) == said(copy.deepcopy(one)) == "run file x.toml: [sweep]: a.b=1"
