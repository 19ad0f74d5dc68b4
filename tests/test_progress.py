"""Long runs talk: lines where there is no terminal, bars where there is one, and run.log with all of it."""

from __future__ import annotations

import io
import os
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.listening import MOST, listening
from b23d.pipeline.scheduling.progress import RunProgress
from b23d.pipeline.scheduling.tally import Tally, span
from b23d.pipeline.scheduling.tasks import Outcome
from b23d.pipeline.stage import stage
from b23d.schemas.params import Params
from tests.toy import Numbers, make_toy


class TalkParams(Params):
    """Of this module, so that workers import it."""


@stage(version=1)
def talk(numbers: Numbers, params: TalkParams) -> Numbers:
    """Says things in every way a library may."""
    print("printed by python")
    os.write(2, b"written by native code\n")
    warnings.warn("something is odd", UserWarning, stacklevel=1)
    return Numbers(values=np.array([1.0]))


@pytest.mark.parametrize("workers", [0, 1])
def test_run_log_has_every_outcome_and_what_was_said(
    tmp_path: Path, workers: int, capfd: pytest.CaptureFixture[str]
) -> None:
    path = make_toy(tmp_path, count=3)
    (tmp_path / "numbers" / "bad.txt").write_text("-13 1")
    run = Run.load(path, ['outputs=["talk", "shift"]'])
    report = run.execute(workers=workers)
    log = (run.folder / "run.log").read_text()
    done, failed = re.findall(r"done +(\w+) of (\S+): [\d.]+ s", log), re.findall(r"failed +(\w+) of (\S+): ", log)
    assert sorted(done) == sorted((o.stage, o.shape) for o in report.done) and len(done) == 10
    assert failed == [("square", "toy/bad")] and "    | ValueError: numbers: expected none to be unlucky" in log
    assert log.count("    | ") >= 4 and log.count("UserWarning: something is odd") >= 1
    assert log.startswith(time.strftime("%Y-")) and log.rstrip().endswith("ended")
    if workers:
        assert log.count("    | printed by python") == 4 and log.count("    | written by native code") == 4
        told = capfd.readouterr()
        assert "printed by python" not in told.out and "native" not in told.err, "not over the bars"


def test_a_log_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    run = Run.load(make_toy(tmp_path, count=3))
    (run.folder / "run.log").mkdir(parents=True)
    assert run.execute(workers=0).ok


def test_where_there_is_no_terminal_a_line_comes_every_so_often(tmp_path: Path) -> None:
    """Before the plan, too, and while nothing ends."""
    out = io.StringIO()
    run = Run.load(make_toy(tmp_path, count=4, extra="[stages.square]\npause = 0.15\n"))
    with RunProgress(Console(file=out, width=200), every=0.05) as progress:
        time.sleep(0.2)
        report = run.execute(workers=0, watch=progress.watch, on_start=progress.start)
    lines = out.getvalue().splitlines()
    assert any(re.match(r"\d\d:\d\d:\d\d  planning for ", line) for line in lines)
    counts = [int(found[1]) for line in lines if (found := re.search(r"  (\d+) of 12 done", line))]
    assert len(report.done) == 12 and counts == sorted(counts) and len(set(counts)) > 1
    assert any("a second; about " in line and "left; running: " in line for line in lines)
    assert "\x1b" not in out.getvalue()


def test_on_a_terminal_one_bar_is_for_all_and_the_stage_at_work_says_so(tmp_path: Path) -> None:
    out = io.StringIO()
    console = Console(file=out, width=120, force_terminal=True)
    run = Run.load(make_toy(tmp_path, count=4, extra="[stages.square]\npause = 0.15\n"))
    with RunProgress(console) as progress:
        run.execute(workers=0, watch=progress.watch, on_start=progress.start)
    text = re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", out.getvalue())
    assert re.search(r"all +\S* *12/12", text) and re.search(r"square .*running", text)
    assert re.search(r"all .*about \d+ s left", text)


def test_the_time_left_is_what_the_rest_took_before() -> None:
    tally = Tally()
    tally.total.update({"slow": 10, "fast": 100})
    tally.began = time.monotonic() - 50.0
    for _ in range(5):
        tally.hear(Outcome("slow", "", "", seconds=10.0))
    left = tally.seconds_left()
    assert left == pytest.approx(50.0 / 50.0 * (5 * 10 + 100 * 10), rel=0.02), "what was never seen is like the rest"
    for _ in range(100):
        tally.hear(Outcome("fast", "", "", seconds=0.0))
    assert tally.seconds_left() == pytest.approx(50.0, rel=0.02)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (99, "99 s"), (101, "2 min"), (3600, "60 min"), (12000, "3 h 20 min")]
)
def test_lengths_of_time_are_words(seconds: float, text: str) -> None:
    assert span(seconds) == text


def test_listening_keeps_the_end_and_gives_the_streams_back(capfd: pytest.CaptureFixture[str]) -> None:
    with listening(apart=True) as said:
        os.write(1, b"x" * (2 * MOST) + b"end")
    os.write(1, b"after")
    assert said.text.endswith("end") and len(said.text) == MOST
    with pytest.raises(KeyError), listening(apart=True) as said:
        os.write(1, b"before the error")
        raise KeyError
    assert said.text == "before the error"
    assert capfd.readouterr().out == "after"
