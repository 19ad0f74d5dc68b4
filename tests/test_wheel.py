"""`b23d` is the only name that a wheel installs, and it works beside a user's own `pipeline`, `stages`, `schemas`."""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("pipeline", "schemas", "stages")
RUN = """
name = "mine"
outputs = ["normalize"]
[dataset]
kind = "procedural"
classes = ["chair"]
count = 3
[shots]
count = 2
draws = [0]
[stages.normalize]
count = 64
"""
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


def build(source: Path, out: Path, kind: str) -> Path:
    """A wheel or an sdist as setuptools makes it, with no network."""
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(out)!r}))"
    out.mkdir(exist_ok=True)
    done = subprocess.run([sys.executable, "-c", code], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The repository without what is made in it."""
    copy = tmp_path_factory.mktemp("source") / "b23d"
    made = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*")
    copy.mkdir()
    for folder in ("b23d", *PACKAGES):
        shutil.copytree(ROOT / folder, copy / folder, symlinks=True, ignore=made)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy / name)
    return copy


@pytest.fixture(scope="module")
def wheel(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tree, tmp_path_factory.mktemp("wheel"), "wheel")


def contents(wheel: Path) -> set[str]:
    return {name for name in zipfile.ZipFile(wheel).namelist() if not name.split("/")[0].endswith(".dist-info")}


def test_it_holds_b23d_and_nothing_else(wheel: Path, tree: Path) -> None:
    files = {
        f"b23d/{path.relative_to(tree).as_posix()}"
        for package in PACKAGES
        for path in (tree / package).rglob("*")
        if path.is_file()
    }
    assert len(files) > 200
    assert contents(wheel) == files | {"b23d/__init__.py", "b23d/py.typed"}


def test_the_sdist_gives_the_same_wheel(wheel: Path, tree: Path, tmp_path: Path) -> None:
    sdist = build(tree, tmp_path / "sdist", "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    assert contents(build(unpacked, tmp_path / "again", "wheel")) == contents(wheel)


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment with the wheel; what it needs is borrowed from this one's site-packages."""
    home = tmp_path_factory.mktemp("venv")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(home)], check=True)
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    python = home / "bin" / "python"
    packages = Path(subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout.strip())
    zipfile.ZipFile(wheel).extractall(packages)
    borrowed = [path for path in dict.fromkeys([*site.getsitepackages(), *sys.path]) if path.endswith("-packages")]
    (packages / "borrowed.pth").write_text("\n".join(borrowed) + "\n")
    return python


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A user's folder with modules of their own, which must never be imported in the place of b23d's."""
    for package in PACKAGES[1:]:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("raise RuntimeError('the user own module')\n")
    (tmp_path / "pipeline.py").write_text("raise RuntimeError('the user own module')\n")
    (tmp_path / "mine.toml").write_text(RUN)
    return tmp_path


def test_it_runs_beside_a_users_own_modules(python: Path, project: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(project)}

    def call(*arguments: str) -> str:
        done = subprocess.run([python, *arguments], cwd=project, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    command = ["-m", "b23d.pipeline.cli"]
    assert str(python.parents[1]) in call("-c", "import b23d; print(b23d.__file__)")
    call(*command, "run", "mine.toml", "--workers", "1")  # a worker process imports by name, too
    assert '"cached": 3' in call(*command, "plan", "mine.toml", "--json").replace('"cached":3', '"cached": 3')
    call(*command, "report", "mine.toml")
    code = "import b23d; run = b23d.load('mine.toml'); print(run.execute(workers=0).ok, len(run.shapes))"
    assert call("-c", code).split() == ["True", "3"]
