"""Ctrl-C and SIGTERM: one line, the right exit code, nothing lost; no process left behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
from tests.toy import make_toy

ROOT = Path(__file__).parents[1]
CODE = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background of a shell ignores it
import tests.toy
from b23d.pipeline.cli import main
main()
"""
SLOW = "[stages.square]\npause = 0.2\n"


def start(path: Path, workers: int) -> subprocess.Popen[str]:
    """`b23d run` in a session of its own, so that a signal can go to all its processes, as a terminal's Ctrl-C does."""
    command = [sys.executable, "-c", CODE, "run", str(path), "--workers", str(workers)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=subprocess.STDOUT, text=True, start_new_session=True)


def wait_for_work(folder: Path) -> None:
    deadline = time.monotonic() + 120
    while not list(folder.glob("store/square/*/*/zarr.json")):
        assert time.monotonic() < deadline, "nothing was made"
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("number", "workers", "everybody"),
    [(signal.SIGINT, 2, True), (signal.SIGTERM, 2, False), (signal.SIGTERM, 1, True), (signal.SIGINT, 0, True)],
)
def test_a_stopped_run_says_so_in_one_line(tmp_path: Path, number: int, workers: int, everybody: bool) -> None:
    path = make_toy(tmp_path, count=30, extra=SLOW)
    process = start(path, workers)
    wait_for_work(tmp_path)
    below = psutil.Process(process.pid).children(recursive=True)
    (os.killpg if everybody else os.kill)(process.pid, number)
    output = process.communicate(timeout=60)[0]
    assert process.returncode == 128 + number
    found = re.search(r"^stopped: (\d+) of 116 stored; run again to go on\s*\Z", output, re.MULTILINE)
    assert found, output
    assert "Traceback" not in output and "Error" not in output
    assert not psutil.wait_procs(below, timeout=20)[1], "processes left behind"
    store = Store(tmp_path / "store")
    stored = [(stage, address) for stage in store.stages() for address in store.addresses(stage)]
    assert len(stored) >= int(found[1]) and not any(store.damage(*item) for item in stored)
    again = Run.load(path).execute(workers=0)
    assert again.ok and len(again.done) == 116 - len(stored)


def test_what_a_stop_cuts_short_is_told_by_no_traceback_after_the_clusters_end(tmp_path: Path) -> None:
    code = (
        "import logging; import tests.toy; from b23d.pipeline.run import Run;"
        f"Run.load({str(make_toy(tmp_path))!r}).execute(workers=1);"
        'logging.getLogger("distributed.batched").error("cut short")'
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and "cut short" not in done.stdout + done.stderr


@pytest.mark.parametrize("pause", [0.0, 0.02, 0.2])
def test_stopped_twice_it_ends_at_once_and_without_a_word(tmp_path: Path, pause: float) -> None:
    process = start(make_toy(tmp_path, count=30, extra=SLOW), workers=1)
    wait_for_work(tmp_path)
    os.killpg(process.pid, signal.SIGINT)
    time.sleep(pause)
    os.killpg(process.pid, signal.SIGINT)
    output = process.communicate(timeout=20)[0]
    assert process.returncode == 130
    assert "Traceback" not in output and "Warning" not in output
