"""A sample of what `tests/attacks/` tries at length: kills, races, flipped bits."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from b23d.pipeline.run import Run
from tests.attacks.flips import flip_everything
from tests.attacks.kills import kill_gc, kill_runs, kill_verify
from tests.attacks.races import race_gc, race_runs, race_writers
from tests.toy import make_toy


@pytest.mark.parametrize("attack", [kill_runs, kill_gc, kill_verify])
def test_kills(tmp_path: Path, attack: object) -> None:
    attack(tmp_path, 4, random.Random(1))  # type: ignore[operator]


@pytest.mark.parametrize("attack", [race_writers, race_runs, race_gc])
def test_races(tmp_path: Path, attack: object) -> None:
    assert attack(tmp_path, 4) == 4  # type: ignore[operator]


def test_flips(tmp_path: Path) -> None:
    run = Run.load(make_toy(tmp_path))
    run.execute(workers=0)
    tried, fell = flip_everything(run, 150, random.Random(0))
    assert tried.keys() == {"square", "shift", "add"} and fell == []
