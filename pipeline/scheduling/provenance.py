"""Provenance: what made an artifact, recorded beside it. Nothing of it enters an address or a content's digest."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from b23d.pipeline.stage import load_stages_once

if TYPE_CHECKING:
    from b23d.pipeline.scheduling.tasks import Task

PACKAGES = ("b23d", "numpy", "zarr", "dask")
"""The engine's own; stages add theirs through the entry-point group `b23d.packages`."""


def provenance(task: Task, seconds: float, peak_mb: float, parts: Mapping[str, float], said: str) -> dict[str, Any]:
    """`parts`: seconds of each stage that ran for it, and of reading; `said`: what libraries printed and warned."""
    stage = load_stages_once()[task.stage]
    return {
        "stage": task.stage,
        "version": stage.version,
        "address": task.address,
        "shape": task.shape,
        "draws": list(task.draws),
        "shots": list(task.shots),
        "params": task.params.hashed(),
        "inputs": task.input_addresses(),
        "accepted": list(task.accepted),
        "inline": {inner.address: _recipe(inner) for inner in task.nested()},
        "seconds": round(seconds, 4),
        "parts": {name: round(took, 4) for name, took in parts.items()},
        "said": said,
        "peak_mb": round(peak_mb, 1),
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "device": _device(),
        "code": _commit(),
        "versions": _versions(),
    }


def environment() -> dict[str, Any]:
    """What the code runs as and on: commit, package versions, machine."""
    return {"code": _commit(), "versions": _versions(), "device": _device()}


def _recipe(task: Task) -> dict[str, Any]:
    """What a transient task was made from: it has no provenance of its own."""
    version = load_stages_once()[task.stage].version
    return {"stage": task.stage, "version": version, "params": task.params.hashed(), "inputs": task.input_addresses()}


@cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in (*PACKAGES, *(name for plugin in entry_points(group="b23d.packages") for name in plugin.load())):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def _commit() -> str | None:
    """The code's git commit, where it runs from a checkout; `+` when the checkout has changes."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=12", "--dirty=+"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip() or None
    except (OSError, subprocess.SubprocessError):
        return None


def _device() -> str:
    import sys

    torch = sys.modules.get("torch")  # a stage that used it has imported it
    if torch is not None and torch.cuda.is_available():
        return str(torch.cuda.get_device_name())
    return f"{platform.machine()}, {os.cpu_count()} cores"
