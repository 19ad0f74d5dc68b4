"""`b23d doctor`: what works on this machine, what is missing, how to mend it."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import typer
from rich.console import Console
from rich.markup import escape

from b23d.pipeline.verbs.options import DEFAULT_STORE, Json, StoreUrl
from b23d.schemas.wording import counted


@dataclass(frozen=True)
class Finding:
    what: str
    works: bool
    detail: str
    mend: str = ""
    needed: bool = True
    """False: the main job runs without it."""


def doctor(store: StoreUrl = None, as_json: Json = False) -> None:
    """Python, torch, GPU, renderers, weights, store: what works, what is missing, how to mend it."""
    console, failed = Console(), False
    checks: list[Callable[[], Iterator[Finding]]] = [
        _python,
        _packages,
        _torch,
        _renderers,
        _weights,
        lambda: _store(store or DEFAULT_STORE),
    ]
    if as_json:
        found = [finding for check in checks for finding in check()]
        print(json.dumps([asdict(finding) for finding in found], indent=1))
        raise typer.Exit(any(finding.needed and not finding.works for finding in found))
    for check in checks:
        for finding in check():
            mark = "[green]✓[/]" if finding.works else "[red]✗[/]" if finding.needed else "[yellow]–[/]"
            console.print(f"{mark} [bold]{finding.what}[/]: {escape(finding.detail)}", highlight=False, soft_wrap=True)
            if not finding.works and finding.mend:
                console.print(f"    → {escape(finding.mend)}", highlight=False, soft_wrap=True)
            failed |= finding.needed and not finding.works
    if failed:
        raise typer.Exit(1)


def _python() -> Iterator[Finding]:
    yield Finding("python", sys.version_info >= (3, 11), platform.python_version(), "use Python 3.11 or newer")


def _packages() -> Iterator[Finding]:
    for name in ("numpy", "scipy", "trimesh", "embreex", "potpourri3d", "transformers", "zarr", "dask"):
        try:
            yield Finding(name, True, version(name))
        except PackageNotFoundError:
            yield Finding(name, False, "not installed", f"pip install {name}")


def _torch() -> Iterator[Finding]:
    try:
        import torch
    except ImportError as error:
        yield Finding("torch", False, str(error), "pip install torch")
        return
    fast = torch.backends.cpu.get_cpu_capability()
    yield Finding(
        "torch",
        True,
        f"{torch.__version__}, {counted(torch.get_num_threads(), 'thread')} of "
        f"{counted(os.cpu_count() or 1, 'core')}, {fast}",
    )
    gpu = torch.cuda.is_available()
    yield Finding("gpu", gpu, torch.cuda.get_device_name() if gpu else "none; encoders run on the CPU", needed=False)


def _renderers() -> Iterator[Finding]:
    """Each in a process of its own: a broken OpenGL driver takes its process with it."""
    embree = "import numpy as np; from embreex import rtcore_scene; rtcore_scene.EmbreeScene()"
    yield _probe("embree", embree, "pip install embreex", needed=True)
    egl = (
        "import os; os.environ['PYOPENGL_PLATFORM'] = 'egl'; import pyrender; pyrender.OffscreenRenderer(8, 8).delete()"
    )
    mend = "apt-get install libegl1 libgles2 libgl1-mesa-dri, or a GPU driver with EGL; embree needs neither"
    yield _probe("pyrender (EGL)", egl, mend, needed=False)


def _probe(what: str, code: str, mend: str, needed: bool) -> Finding:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return Finding(
        what, done.returncode == 0, "works" if done.returncode == 0 else f"exit {done.returncode}: {last}", mend, needed
    )


def _weights() -> Iterator[Finding]:
    from b23d.stages.extract import ExtractParams, weights_digest

    for encoder, needed in (("efficientnet-lite0", True), ("saliency-vit-s14", False)):
        try:
            digest = weights_digest(ExtractParams(encoder=encoder))["weights"]
            yield Finding(f"weights of {encoder}", True, f"sha256 {digest[:16]}", needed=needed)
        except (OSError, ValueError) as error:
            yield Finding(f"weights of {encoder}", False, str(error), needed=needed)
    hub = Path(os.environ.get("HF_HOME", Path.home() / ".cache" / "huggingface")) / "hub"
    models = (
        sorted(path.name.removeprefix("models--").replace("--", "/") for path in hub.glob("models--*"))
        if hub.is_dir()
        else []
    )
    mend = 'the first run with a hub encoder (stages.extract.encoder = "dinov2-small") downloads it'
    yield Finding("hub cache", bool(models), ", ".join(models) or "empty", mend, needed=False)


def _store(url: str) -> Iterator[Finding]:
    from b23d.pipeline.store import Store

    try:
        store = Store(url)
        store.check_writable()
        free = f", {shutil.disk_usage(store.root).free / 1e9:.0f} GB free" if store.local else ""
        yield Finding("store", True, f"{url} can be written{free}")
    except (OSError, ValueError, ImportError) as error:
        yield Finding("store", False, str(error), "give another with --store")
