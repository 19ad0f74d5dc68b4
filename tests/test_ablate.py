"""`b23d ablate`: the order of the steps, detours, fixed fields, and that only what a step changes is run again."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.config import load_config
from b23d.stages.workbench.commands.ablate import DETOURS
from b23d.stages.workbench.results.changes import Change, changes, members
from tests.small_runs import make_boxes

plug_in()
RUNS = Path(__file__).parents[1] / "runs"


def way(
    origin: str = "released", goal: str = "corrected", via: list[str] = DETOURS, fixed: tuple[str, ...] = ()
) -> list[Change]:
    run = load_config(RUNS / "keypointnet.toml")
    start = RUNS / f"{origin}.toml"
    names = [text.partition("=")[0] for text in via]
    return changes(
        load_config(start), load_config(RUNS / f"{goal}.toml"), run.stages, load_config(start, via), names, fixed
    )


def test_the_way_is_one_field_at_a_time_from_one_setting_to_the_other() -> None:
    for via in (DETOURS, []):
        state = {name: params.hashed() for name, params in load_config(RUNS / "released.toml").params.items()}
        for change in way(via=via):
            _, stage, key = change.field.split(".")
            assert state[stage][key] == change.old != change.new
            state[stage][key] = change.new
        assert state == {name: params.hashed() for name, params in load_config(RUNS / "corrected.toml").params.items()}


def test_steps_are_in_dataflow_order_between_the_detours() -> None:
    steps = way()
    assert [str(step) for step in (steps[0], *steps[-2:])] == [
        "optimize.method: softmax → discrete",
        "optimize.method: discrete → posterior",
        "optimize.presence: all → evidence",
    ]
    order = list(load_config(RUNS / "keypointnet.toml").stages)
    stages = [order.index(step.field.split(".")[1]) for step in steps[1:-2]]
    assert stages == sorted(stages)
    assert len({step.field for step in steps[1:-2]}) == len(steps) - 3


def test_detours_are_for_fields_that_differ() -> None:
    assert {step.field for step in way("corrected", "corrected")} == set()
    assert [step.field for step in way("paper", "released")].count("stages.optimize.method") == 0
    straight = way(via=[])
    assert [step.field for step in straight].count("stages.optimize.method") == 1
    assert {step.field for step in straight} == {step.field for step in way()}


def test_fixed_fields_have_no_step() -> None:
    assert not {"stages.optimize.alpha", "stages.optimize.method"} & {
        step.field for step in way(fixed=("stages.optimize.alpha", "stages.optimize.method"))
    }


def test_members_say_every_field_of_the_way() -> None:
    steps = [Change("stages.a.x", 1, 2), Change("stages.b.y", None, ["u"]), Change("stages.a.x", 2, 3)]
    found = members("start", steps, "n")
    assert [m.label for m in found] == ["start", "a.x: 1 → 2", 'b.y: null → ["u"]', "a.x: 2 → 3"]
    assert [m.overrides[0] for m in found] == ["stages.a.x=1", "stages.a.x=2", "stages.a.x=2", "stages.a.x=3"]
    assert [m.overrides[1] for m in found] == [
        "stages.b.y=null",
        "stages.b.y=null",
        'stages.b.y=["u"]',
        'stages.b.y=["u"]',
    ]
    assert all(m.overrides[-1] == "name=n" for m in found)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ablate")
    for name in ("released", "corrected"):
        shutil.copy(RUNS / f"{name}.toml", folder)
    return make_boxes(folder, count=3)


def ablate(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["ablate", *arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_dry_run_prints_the_steps_and_does_nothing(boxes: Path) -> None:
    output = ablate(str(boxes), "--dry-run", "--set", "stages.optimize.alpha=1")
    assert output.splitlines()[0].strip() == "1 optimize.method: softmax → discrete"
    assert "alpha" not in output
    assert not (boxes.parent / "store").exists()


def test_released_to_corrected_end_to_end(boxes: Path) -> None:
    arguments = (str(boxes), "--workers", "0", "--set", "stages.optimize.steps=5")
    output = ablate(*arguments)
    ran = dict(re.findall(r"^(.+): ran (.+) in \d+ s, AUC", output, re.M))
    downstream = ["normalize", "render", "extract", "backproject", "geodesic", "reweight", "optimize", "score"]
    assert ran.pop("released") == ", ".join(downstream)
    assert list(ran) == [str(step) for step in way()]
    for label, stages in ran.items():
        changed = label.split(".")[0]
        allowed = {"geodesic": {"geodesic", "reweight", "optimize", "score"}}.get(
            changed, set(downstream[downstream.index(changed) :])
        )
        assert set(stages.split(", ")) <= allowed - {"geodesic"} | {changed}, label
    table = [line for line in output.splitlines() if "→" in line and "│" in line]
    assert [line.split("│")[1].strip() for line in table] == list(ran), "labels stand on one line each"

    folder = boxes.parent / "boxes"
    steps = json.loads((folder / "ablation.json").read_text())
    assert [step["step"] for step in steps] == ["released", *ran]
    assert all(step["scores"]["classes"]["box"]["targets"] == 1 for step in steps)
    assert "presence" in (folder / "ablation.html").read_text()
    again = ablate(*arguments)
    assert re.findall(r": ran (.+) in \d+ s", again) == ["nothing"] * len(steps)
