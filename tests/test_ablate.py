"""`b23d ablate`: the order of the steps, detours, fixed fields, and that only what a step changes is run again."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.inspection.change import Change
from b23d.pipeline.runfile.config import Config, load_config
from b23d.pipeline.runfile.overrides import Carried
from b23d.stages.workbench.commands.ablate import DETOURS
from b23d.stages.workbench.results.changes import Way, members, way
from tests.small_runs import make_boxes

plug_in()
RUNS = Path(__file__).parents[1] / "runs"


def between(
    origin: str = "released", goal: str = "corrected", via: list[str] = DETOURS, fixed: tuple[str, ...] = ()
) -> Way:
    start, end = RUNS / f"{origin}.toml", RUNS / f"{goal}.toml"
    detours = [load_config(path, map(Carried, via)) for path in (start, end)]
    names = [text.partition("=")[0] for text in via]
    return way(
        load_config(start), load_config(end), load_config(RUNS / "keypointnet.toml").stages, detours, names, fixed
    )


def hashes(config: Config) -> dict[str, object]:
    return {name: params.hashed() for name, params in config.params.items()}


def test_the_way_leads_from_one_setting_to_the_other() -> None:
    for via in (DETOURS, []):
        series = members("start", between(via=via), "n")
        first, *_, last = (load_config(RUNS / "keypointnet.toml", member.overrides[:-1]) for member in series)
        for found, name in ((first, "released"), (last, "corrected")):
            wanted = hashes(load_config(RUNS / f"{name}.toml", ["stages.extract.encoder=efficientnet-lite0"]))
            assert hashes(found) == wanted, name


def test_every_step_changes_an_address() -> None:
    """One field at a time, and none that does not count."""
    series = members("start", between(), "n")
    made = [hashes(load_config(RUNS / "keypointnet.toml", member.overrides[:-1])) for member in series]
    for one, other, member in zip(made, made[1:], series[1:], strict=False):
        differ = [stage for stage in one if one[stage] != other[stage]]
        assert differ == [member.label.split(".")[0]], member.label


def test_steps_are_in_dataflow_order_between_the_detours() -> None:
    steps = between().steps
    assert [step.step for step in (steps[0], *steps[-2:])] == [
        "optimize.method: softmax → discrete",
        "optimize.method: discrete → posterior",
        "optimize.presence: all → evidence",
    ]
    order = list(load_config(RUNS / "keypointnet.toml").stages)
    stages = [order.index(step.field.split(".")[1]) for step in steps[1:-2]]
    assert stages == sorted(stages)
    assert len({step.field for step in steps[1:-2]}) == len(steps) - 3
    assert "stages.optimize.alpha" in {step.field for step in steps}


def test_detours_are_for_fields_that_differ() -> None:
    assert between("corrected", "corrected").steps == []
    assert [step.field for step in between("paper", "released").steps].count("stages.optimize.method") == 0
    straight = [step.field for step in between(via=[]).steps]
    assert straight.count("stages.optimize.method") == 1
    assert set(straight) - {"stages.optimize.method"} < {step.field for step in between().steps} | {
        field for field in straight if field.startswith("stages.optimize.softmax.")
    }


def test_fixed_fields_have_no_step() -> None:
    fixed = ("stages.optimize.alpha", "stages.optimize.method")
    assert not set(fixed) & {step.field for step in between(fixed=fixed).steps}


def test_members_say_every_field_of_the_way() -> None:
    steps = [Change("stages.a.x", 1, 2), Change("stages.b.y", None, ["u"]), Change("stages.a.x", 2, 3)]
    found = members("start", Way({"stages.a.x": 1, "stages.b.y": None}, steps), "n")
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
    arguments = (str(boxes), "--workers", "0", "--set", "stages.optimize.softmax.steps=5")
    output = ablate(*arguments)
    ran = dict(re.findall(r"^(.+): ran (.+) in \d+ s, AUC", output, re.M))
    downstream = ["normalize", "render", "extract", "backproject", "geodesic", "reweight", "learn", "optimize", "score"]
    assert ran.pop("released") == ", ".join([*downstream[:6], "annotation", *downstream[6:]])
    assert list(ran) == [step.step for step in between().steps]
    for label, stages in ran.items():
        changed = label.split(".")[0]
        allowed = {"geodesic": {"geodesic", "reweight", "learn", "optimize", "score"}}.get(
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
