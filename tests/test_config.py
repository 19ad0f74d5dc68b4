"""Run files: closed, overridable, with errors that say what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from b23d.pipeline.config import load_config
from b23d.pipeline.errors import RunFileError
from tests.toy import make_toy


def test_overrides_and_types(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    config = load_config(path, ["stages.square.power=3", "shots.draws=[7]", "name=other", 'store.transient=["square"]'])
    assert (
        config.params["square"].model_dump()["power"] == 3
        and config.file.shots.draws == [7]
        and config.file.name == "other"
    )


def test_roots_are_relative_to_the_file_or_with_set_to_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make_toy(tmp_path)
    assert load_config(path).dataset.model_dump()["root"] == (tmp_path / "numbers").resolve()
    monkeypatch.chdir(tmp_path.parent)
    assert load_config(path, ["dataset.root=x"]).dataset.model_dump()["root"] == (tmp_path.parent / "x").resolve()


def test_a_base_is_extended(tmp_path: Path) -> None:
    make_toy(tmp_path, extra="[stages.square]\npower = 4.0\n")
    (tmp_path / "sub").mkdir()
    variant = tmp_path / "sub" / "variant.toml"
    variant.write_text('name = "variant"\nbase = "../toy.toml"\n[shots]\ncount = 1\n')
    config = load_config(variant)
    assert config.file.shots.count == 1 and config.params["square"].model_dump()["power"] == 4
    assert config.dataset.model_dump()["root"] == (tmp_path / "numbers").resolve()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("stages.square.powr=1", "did you mean 'power'"),
        ("stages.squar.power=1", "did you mean 'square'"),
        ("stages.square.power=wide", "valid number"),
        ("dataset.kind=toi", "did you mean 'toy'"),
        ("dataset.rot=1", "did you mean 'root'"),
        ("shot.count=1", "did you mean 'shots'"),
        ('outputs=["ad"]', "did you mean 'add'"),
        ('feeds.shift="squar"', "did you mean 'square'"),
        ("stages.square.power=nan", "finite"),
        ("no-equals", "expected a.b=value"),
    ],
)
def test_errors_say_what_to_do(tmp_path: Path, override: str, message: str) -> None:
    with pytest.raises(RunFileError, match=message):
        load_config(make_toy(tmp_path), [override])


def test_missing_and_broken_files(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="expected a TOML file"):
        load_config(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("a = ")
    with pytest.raises(RunFileError, match="syntax error"):
        load_config(tmp_path / "bad.toml")
