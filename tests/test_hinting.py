"""What a name that is not known was meant to be."""

from __future__ import annotations

from pathlib import Path

import pytest

from b23d.pipeline.errors import RunFileError, SelectionError
from b23d.pipeline.inspection.listing import list_artifacts
from b23d.pipeline.planning.hinting import hint
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from tests.small_runs import b23d, make_boxes

NAMES = [f"{name}/{name[:-1]}{i}" for name in ("boxes", "chairs", "mugs") for i in range(3)]


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("mgs/*", "mugs/*"),
        ("Mugs/*", "mugs/*"),
        ("mgs/mug1", "mugs/mug1"),
        ("chairs/chair9", "chairs/chair"),
        ("chairs/zzz*", "chairs/"),
        ("chair/chair1", "chairs/chair1"),
        ("mug1", "mugs/mug1"),
        ("muug1", "mugs/mug"),
        ("char*", "chairs/"),
    ],
)
def test_what_is_meant_is_of_the_class_that_is_meant(typed: str, meant: str) -> None:
    assert hint(typed, NAMES).startswith(f"did you mean '{meant}")


def test_what_is_like_nothing_gets_an_example_or_what_is_given() -> None:
    assert hint("zzz/*", NAMES) == "for example 'boxes/boxe0'"
    assert hint("zzz", NAMES, "check the name") == "check the name"
    assert hint("zzz", []) == hint("zzz/z", []) == hint("", []) == "there are none"


@pytest.mark.parametrize("name", [*NAMES, *(name.partition("/")[2] for name in NAMES)])
def test_every_name_is_nearest_to_itself(name: str) -> None:
    assert name in hint(name, NAMES)


def test_every_verb_knows_which_stage_is_meant(tmp_path: Path) -> None:
    run = Run.load(make_boxes(tmp_path, 3))
    path, meant = str(run.config.path), "got 'optimise'; did you mean 'optimize'"
    for verb in ("show", "explain", "try"):
        with pytest.raises(KeyError, match=meant):
            b23d(verb, path, "box/b0", "optimise")
    with pytest.raises(KeyError, match=meant):
        list(run.collect("optimise"))
    with pytest.raises(SelectionError, match=meant):
        list_artifacts(run, "optimise")
    with pytest.raises(SelectionError, match=meant):
        b23d("plan", path, "--until", "optimise")
    with pytest.raises(ValueError, match=meant):
        b23d("accept", path, "optimise")


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("reweight.sigma=2", "did you mean 'stages.reweight.sigma'"),
        ("optimize.discrete.starts=2", "did you mean 'stages.optimize.discrete.starts'"),
        ("optimise.method=discrete", "did you mean 'stages.optimize.method'"),
        ("reweight=2", "did you mean 'stages.reweight'"),
        ("sigma=2", "set stages.reweight.sigma"),
        ("count=2", "set shots.count"),
        ("datset.kind=folder", "did you mean 'dataset'"),
        ("stage.reweight.sigma=2", "did you mean 'stages'"),
        ("zzz=2", "it takes "),
    ],
)
def test_a_key_at_the_top_that_belongs_below_is_told_so(text: str, meant: str, tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 1)
    with pytest.raises(RunFileError) as error:
        load_config(path, [text])
    assert f"; {meant}" in str(error.value) or str(error.value).endswith(meant)
