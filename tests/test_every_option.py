"""Every option of every stage moves something: on small inputs, changing it changes what the stage makes, and never
where its choice is not taken. A new option without a case here is an error."""

from __future__ import annotations

from typing import Any

import pytest

from b23d.pipeline.stage import load_stages
from b23d.schemas.params import Params
from tests import option_cases as cases
from tests.option_cases import MAKE, Make, stage
from tests.option_changes import CASES
from tests.test_geodesic import plate

ELSEWHERE: dict[str, Make] = {
    "geodesic.graph.shortcuts": lambda params: stage("geodesic").function(plate(count=300), params),
    "normalize.stray": cases.with_outlier,
    "render.disc_radius": lambda params: stage("render").function(cases.bare(), params),
    "render.disc_neighbours": lambda params: stage("render").function(cases.bare(), params),
    "optimize.softmax.one_to_one": cases.solved_on_few,
    **{f"learn.{name}": lambda params: cases.taught(params, turned=True) for name in ("gate_prior", "same_frame")},
    **{
        f"optimize.posterior.{name}": lambda params: cases.solved(params, turned=True)
        for name in ("turns", "turn_concentration", "sides_sd", "surface_weight", "contrast_weight", "temper")
    },
}
"""Options that show on other inputs than their stage's."""


def build(name: str, settings: dict[str, Any]) -> Params:
    tables: dict[str, Any] = {}
    for dotted, value in settings.items():
        *above, key = dotted.split(".")
        table = tables
        for step in above:
            table = table.setdefault(step, {})
        table[key] = value
    made: Params = stage(name).params.model_validate(tables)
    return made


def made(make: Make, params: Params) -> list[Any]:
    """Arrays, numbers and words, or the error."""
    try:
        artifact = make(params)
    except (ValueError, RuntimeError, ImportError) as error:
        return [type(error).__name__, str(error)]
    arrays = [(name, array.shape, array.tobytes()) for name, array in sorted(artifact.present_arrays().items())]
    return [*arrays, *(value for value in artifact.plain_fields().values() if isinstance(value, float | str))]


OPTIONS = [
    (name, option.name)
    for name, one in sorted(load_stages().items())
    for option in one.params().options()
    if not option.unhashed and one.function.__module__.startswith("b23d.")
]


def test_every_option_has_a_case() -> None:
    assert {(name, option) for name, found in CASES.items() for option in found} == set(OPTIONS)


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda word: word)
def test_changing_an_option_changes_the_result(name: str, option: str) -> None:
    settings, other = CASES[name][option]
    one, two = build(name, settings), build(name, {**settings, option: other})
    assert one.hashed() != two.hashed(), f"{option} does not count beside {settings}"
    make = ELSEWHERE.get(f"{name}.{option}", MAKE[name])
    first, second = made(make, one), made(make, two)
    assert isinstance(first[0], tuple) or isinstance(second[0], tuple), f"neither works: {first}"
    assert first != second


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda word: word)
def test_an_option_that_does_not_count_enters_no_address(name: str, option: str) -> None:
    plain = build(name, {})
    counting = {found.name for found in plain.options() if found.counts}
    if option not in counting:
        settings, other = CASES[name][option]
        chooses = {key: value for key, value in settings.items() if key not in counting}
        assert build(name, {**chooses, option: other}).hashed() == plain.hashed()


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=lambda word: word)
def test_every_option_says_what_it_does(name: str, option: str) -> None:
    (found,) = (found for found in stage(name).params().options() if found.name == option)
    assert found.field.description
