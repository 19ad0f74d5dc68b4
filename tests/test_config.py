"""Run files: closed, overridable, with errors that say what to do."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from b23d.pipeline.errors import MissingPackageError, RunFileError
from b23d.pipeline.runfile.config import load_config, refuse_unused
from b23d.pipeline.runfile.members import members
from b23d.pipeline.runfile.overrides import Carried
from tests.toy import make_toy

RUNS = Path(__file__).parents[1] / "runs"


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
        ("stages.square.power=wide", "--set stages.square.power=wide: power: expected a number, got 'wide'"),
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


# options of methods


def test_an_option_of_a_method_that_is_not_chosen_is_an_error_that_says_how_to_choose_it() -> None:
    run = RUNS / "corrected.toml"
    for override, wanted in [
        (
            "stages.optimize.discrete.starts=2",
            "discrete; choose that with --set stages.optimize.method=discrete",
        ),
        ("stages.optimize.discrete={starts = 2}", "--set stages.optimize.method=discrete"),
        ("stages.render.fibonacci.views=9", "--set stages.render.layout=fibonacci"),
        ("stages.normalize.watertight_resolution=32", "--set stages.normalize.watertight=true"),
        ("stages.calibrate.iss.gamma_21=.9", "--set stages.calibrate.method=iss"),
    ]:
        with pytest.raises(RunFileError, match=re.escape(wanted)):
            load_config(run, [override])
    both = ["stages.optimize.discrete={softmax = {steps = 5}}", "stages.optimize.method=discrete"]
    with pytest.raises(RunFileError, match=r"--set stages\.optimize\.discrete\.softmax_start=true"):
        load_config(run, both)
    load_config(run, [*both, "stages.optimize.discrete.softmax_start=true"])


def test_a_run_file_may_hold_several_methods_and_set_switches() -> None:
    run, methods = RUNS / "released.toml", ("softmax", "discrete")
    configs = [load_config(run, [f"stages.optimize.method={method}"]) for method in methods]
    hashed = [config.params["optimize"].hashed() for config in configs]
    assert [sorted(table.keys() & set(methods)) for table in hashed] == [["softmax"], ["discrete"]]
    assert hashed[1]["discrete"]["starts"] == 32
    with pytest.raises(
        RunFileError, match="expected one of 'labelled', 'sorted', got -1"
    ):  # tables not chosen are checked
        load_config(run, [Carried("stages.optimize.hungarian.assignment=-1")])


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("stages.optimize.starts=1", "starts belongs to method discrete: set stages.optimize.discrete.starts"),
        ("stages.optimize.discrete.alpha=1", "alpha belongs to stages.optimize: set stages.optimize.alpha"),
        ("stages.optimize.posterior.ridge=1", "ridge belongs to stages.learn: set stages.learn.ridge"),
        ("stages.optimize.softmax.mask=pairs", "mask belongs to stages.learn: set stages.learn.template.mask"),
        ("stages.optimize.affine_sd=1", "affine_sd belongs to stages.learn: set stages.learn.deformation.affine_sd"),
        (
            "stages.optimize.nearest.features=raw",
            "features belongs to stages.learn: set stages.learn.template.features",
        ),
        ("stages.optimize.steps=1", "steps belongs to method softmax, discrete: set stages.optimize.softmax.steps"),
        ("stages.calibrate.iss_gamma_21=1", "belongs to method iss: set stages.calibrate.iss.gamma_21"),
        ("stages.geodesic.neighbors=9", "belongs to method graph, heat: set stages.geodesic.graph.neighbors"),
        ("stages.learn.method=discrete", "method belongs to stages.optimize: set stages.optimize.method"),
        ("stages.learn.retrieval=true", "retrieval belongs to stages.optimize: set stages.optimize.retrieval"),
        ("stages.learn.alpha=1", "alpha belongs to stages.optimize: set stages.optimize.alpha"),
        ("stages.optimize.discrete.pases=9", "did you mean 'passes'"),
    ],
)
def test_a_field_in_the_wrong_place_is_an_error_that_says_where_it_lives(override: str, message: str) -> None:
    with pytest.raises(RunFileError, match=re.escape(message)):
        load_config(RUNS / "corrected.toml", [override])


def test_a_table_that_was_a_number_says_what_it_takes() -> None:
    with pytest.raises(RunFileError, match=r"rings: expected a table.*it takes count: set rings\.count"):
        load_config(RUNS / "demo.toml", [Carried("stages.render.rings=3")])


def test_what_goes_through_a_series_may_count_in_one_run_of_it_but_not_in_none() -> None:
    text = "stages.optimize.discrete.starts=2"
    methods = [[Carried(text), f"stages.optimize.method={method}"] for method in ("posterior", "discrete")]
    posterior, discrete = (load_config(RUNS / "demo.toml", overrides) for overrides in methods)
    refuse_unused([text], [posterior, discrete])
    with pytest.raises(RunFileError, match="expected an option of method = posterior"):
        refuse_unused([text], [posterior])


@pytest.mark.parametrize("path", sorted(RUNS.rglob("*.toml")), ids=lambda path: path.stem)
def test_every_run_file_and_every_run_of_its_series_is_valid(path: Path) -> None:
    config = load_config(path)
    for member in members(config):
        assert load_config(path, member.overrides).overrides


@pytest.mark.parametrize("group", ["b23d.outputs", "b23d.stages"])
def test_an_installation_older_than_the_code_says_so(
    group: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run of no outputs, or of no stages, must not end well."""
    path = make_toy(tmp_path)
    path.write_text(re.sub(r"(?m)^outputs = .*\n", "", path.read_text()))
    monkeypatch.setattr(
        "b23d.pipeline.stage.entry_points",
        lambda group: () if group == hidden else entry_points(group=group),
    )
    hidden = "none"
    assert load_config(path).file.outputs
    hidden = group
    with pytest.raises(MissingPackageError, match=rf"{re.escape(group)}.*install it again"):
        load_config(path)
