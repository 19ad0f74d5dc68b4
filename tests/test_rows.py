"""The table of differences between the paper, its published code and what is right: which fields each row is, and who
sets them.

What a row's fields do is shown in `test_rows_features.py` and `test_rows_choice.py`: one test a row, on a case made to
show it.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.stage import load_stages
from b23d.schemas.params import Params, tables_of
from b23d.schemas.runfile import Shots
from tests import test_rows_choice, test_rows_features

RUNS = Path(__file__).parents[1] / "runs"
ROWS: dict[int, tuple[str, ...]] = {
    1: ("stages.learn.template.combine",),
    2: ("stages.reweight.batches", "stages.reweight.normalised"),
    3: ("stages.reweight.weight",),
    4: ("stages.backproject.visibility",),
    5: ("stages.reweight.fill",),
    6: ("stages.reweight.sigma",),
    7: ("stages.learn.template.source_features",),
    8: (
        "stages.geodesic.method",
        "stages.geodesic.graph.neighbors",
        "stages.geodesic.graph.shortcuts",
        "stages.geodesic.graph.disconnected",
    ),
    9: ("stages.score.units", "stages.learn.template.distances"),
    10: ("stages.learn.template.mask",),
    11: (
        "stages.optimize.method",
        "stages.optimize.softmax.steps",
        "stages.optimize.softmax.learning_rate",
        "stages.optimize.softmax.seed",
    ),
    12: ("stages.normalize.candidates",),
    13: ("stages.score.inside",),
    14: ("stages.score.iou",),
    15: ("shots.split",),
    16: ("shots.draws",),
    17: ("stages.optimize.hungarian.assignment",),
    18: ("stages.extract.encoder",),
    19: ("stages.backproject.sample",),
    20: ("stages.render.distance",),
    21: ("stages.render.layout", "stages.render.rings.count"),
    22: ("stages.optimize.presence",),
}
PAGE = (Path(__file__).parents[1] / "stages" / "DIFFERENCES.md").read_text()


def test_every_row_is_documented_fields_and_has_its_test() -> None:
    stages, tests = load_stages(), [*vars(test_rows_features), *vars(test_rows_choice)]
    for row, fields in ROWS.items():
        assert any(name.startswith(f"test_row_{row:02}_") for name in tests), f"row {row} has no test"
        for dotted in fields:
            table, *between, key = dotted.split(".")
            model: type[Params] = Shots if table == "shots" else stages[between[0]].params
            for name in between[1:]:
                model = tables_of(model)[name]
            assert (key in model.model_fields and model.model_fields[key].description) or key in (
                "steps",
                "learning_rate",
            ), f"row {row}: {dotted} is no documented field"


def test_the_page_of_differences_has_every_row_and_names_its_fields() -> None:
    rows = {int(line.split("|")[1]): line for line in PAGE.splitlines() if re.match(r"\| \d+ \|", line)}
    assert rows.keys() == ROWS.keys()
    for row, fields in ROWS.items():
        for dotted in fields:
            assert dotted.rpartition(".")[2] in rows[row], f"row {row} does not name {dotted}"


@pytest.mark.parametrize("stage", sorted(load_stages()))
def test_fields_that_name_a_row_name_the_right_one(stage: str) -> None:
    for option in load_stages()[stage].params().options():
        for number in map(int, re.findall(r"DIFFERENCES\.md, row (\d+)", option.field.description or "")):
            assert any(field.endswith(f".{option.name.rpartition('.')[2]}") for field in ROWS[number]), option.name


@pytest.mark.parametrize("name", ["released", "paper", "corrected"])
def test_the_three_run_files_set_every_row(name: str) -> None:
    config = load_config(RUNS / f"{name}.toml")
    for row, fields in ROWS.items():
        for dotted in fields:
            table, *between, key = dotted.split(".")
            params: Params = config.file.shots if table == "shots" else config.params[between[0]]
            for inner in between[1:]:
                params = getattr(params, inner)
            assert key in params.model_fields_set, f"{name}.toml, row {row}: {dotted} is not set"


def test_corrected_is_the_defaults_but_for_the_encoder() -> None:
    for name, params in load_config(RUNS / "corrected.toml").params.items():
        other = type(params)().hashed()
        # a transformer sees foreground patches; the default encoder sees whole pictures
        changed = {key for key, value in params.hashed().items() if value != other.get(key)}
        assert changed <= {"encoder", "foreground"}, name
