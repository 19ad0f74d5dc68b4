"""Every command and every Python line of the README runs, in its order, on data small enough for a test."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from b23d.stages.datasets.procedural import Procedural
from tests.small_runs import FAST

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
FEW = ["stages.normalize.count=256", "stages.render.rings.count=1", "stages.render.resolution=64"]
FEW_SETS = " ".join(f"--set {text}" for text in FEW)
B23D = [sys.executable, "-m", "b23d.pipeline.cli"]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


def commands(text: str) -> list[str]:
    """The b23d commands of a part of the README."""
    lines = (line for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.splitlines())
    return [line.split("#")[0].strip() for line in lines if line.startswith("b23d")]


SECTIONS = {part.split("\n")[0]: found for part in README.split("\n### ") if (found := commands(part))}
"""Heading → its commands, in order; each builds on those before."""


def make_keypointnet(root: Path) -> None:
    """KeypointNet's own layout, from procedural shapes: clouds and annotations of three classes."""
    for number, (theirs, ours) in enumerate([("airplane", "airplane"), ("chair", "chair"), ("table", "table")]):
        entries = []
        (root / "pcds" / f"{number:08d}").mkdir(parents=True)
        for shape in Procedural(kind="procedural", classes=[ours], count=4).shapes():  # type: ignore[list-item]
            leaf, source = shape.leaves["keypoints"], shape.leaves["source"]
            keypoints = leaf.load({}, leaf.values)
            mesh = trimesh_of(source.load({}, source.values))
            points = np.concatenate([keypoints.positions, mesh.sample(300, seed=0)])
            header = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
            header += f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA ascii\n"
            text = header + "\n".join(" ".join(f"{x:.6f}" for x in p) for p in points) + "\n"
            (root / "pcds" / f"{number:08d}" / f"{shape.id}.pcd").write_text(text)
            marks = [
                {"xyz": p.tolist(), "semantic_id": int(i), "pcd_info": {"point_index": row}}
                for row, (i, p) in enumerate(zip(keypoints.ids, keypoints.positions, strict=True))
            ]
            entries.append({"class_id": f"{number:08d}", "model_id": shape.id, "keypoints": marks})
        (root / "annotations").mkdir(exist_ok=True)
        (root / "annotations" / f"{theirs}.json").write_text(json.dumps(entries))


def trimesh_of(source: object) -> object:
    import trimesh

    return trimesh.load(trimesh.util.wrap_as_stream(source.files["mesh.ply"]), file_type="ply", process=False)  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder as the README's reader has it: run files (made small), their own shapes, KeypointNet."""
    folder = tmp_path_factory.mktemp("readme")
    kept = (".toml", "variants", "analyses", "textured-keypoints.json")
    shutil.copytree(
        ROOT / "runs", folder / "runs", ignore=lambda d, names: [name for name in names if not name.endswith(kept)]
    )
    make_keypointnet(folder / "path" / "to" / "keypointnet")
    shutil.copytree(folder / "path" / "to" / "keypointnet", folder / "data" / "keypointnet")
    shapes = folder / "my-shapes" / "chairs"
    shapes.mkdir(parents=True)
    entries = []
    chairs = Procedural(kind="procedural", classes=["chair"], count=4).shapes()
    for name, shape in zip(["armchair", "stool", "throne", "bench"], chairs, strict=True):
        source, leaf = shape.leaves["source"], shape.leaves["keypoints"]
        (shapes / f"{name}.ply").write_bytes(source.load({}, source.values).files["mesh.ply"])
        keypoints = leaf.load({}, leaf.values)
        marks = [
            {"xyz": p.tolist(), "semantic_id": int(i)} for i, p in zip(keypoints.ids, keypoints.positions, strict=True)
        ]
        entries.append({"model_id": name, "keypoints": marks})
    (folder / "my-shapes" / "keypoints.json").write_text(json.dumps(entries[:3]))
    for name in (
        "demo",
        "keypointnet",
        "paper-table",
        "analyses/isometric",
    ):  # made small: few views, few candidates
        path = folder / "runs" / f"{name}.toml"
        text = re.sub(r"^\[stages\.(normalize|render|extract|optimize)\][^\[]*", "", path.read_text(), flags=re.M)
        text = re.sub(r"draws = \[[0-9, ]*\]", "draws = [0]", re.sub(r"count = 8\b", "count = 4", text))
        path.write_text(text + FAST)
    yield folder


def run(workplace: Path, command: str, scheduler: str) -> subprocess.CompletedProcess[str]:
    """A README command, with what only exists elsewhere replaced: a cluster, a bucket, 32 cores."""
    words = command.replace("tcp://head-node:8786", scheduler).replace(
        "s3://bucket/b23d", (workplace / "bucket").as_uri()
    )
    words = words.replace("--workers 32", "--workers 2")
    import shlex

    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*B23D, *shlex.split(words)[1:]], cwd=workplace, capture_output=True, text=True, env=environment
    )


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as running:
        yield running.scheduler_address


def make_small(path: Path) -> None:
    """Few views and few candidates for a run file that `b23d init` has written."""
    path.write_text(re.sub(r"^\[stages\.extract\][^\[]*", "", path.read_text(), flags=re.M) + FAST)


def annotated_for_a_moment(workplace: Path, command: str) -> str:
    """`b23d annotate` says where its page is, and goes on until it is stopped."""
    words = [*B23D, *command.split()[1:], "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(words, cwd=workplace, stdout=subprocess.PIPE, text=True, env=environment) as serving:
        assert serving.stdout is not None
        line = serving.stdout.readline()
        serving.send_signal(signal.SIGINT)
    return line


@pytest.mark.parametrize("section", SECTIONS)
def test_every_command_runs(workplace: Path, cluster: str, section: str) -> None:
    for command in SECTIONS[section]:
        if command.startswith("b23d annotate"):
            assert "http://127.0.0.1" in annotated_for_a_moment(workplace, command)
            continue
        if command == "b23d plan runs/demo.toml":
            assert (
                run(workplace, "b23d run runs/demo.toml --workers 2", cluster).returncode == 0
            )  # make demo has run before
        small = f" {FEW_SETS}" if command.startswith("b23d match") else ""
        done = run(workplace, command + small, cluster)
        assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
        if command.startswith("b23d init"):
            make_small(workplace / "runs" / "my-shapes.toml")


def test_the_commands_left_what_they_say(workplace: Path) -> None:
    assert sum(map(len, SECTIONS.values())) >= 20
    assert (workplace / "runs" / "demo" / "report.html").stat().st_size > 10_000
    assert (workplace / "chair.ply").exists() and (workplace / "bench.glb").exists()
    table = (workplace / "keypoints.csv").read_text().splitlines()
    assert table[0].startswith("class,shape,id,name,x,y,z") and "chairs,bench," in table[1]


def test_the_python_example_runs(workplace: Path, cluster: str) -> None:
    code = next(block for block in blocks("python") if "import b23d" in block)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    if not (workplace / "runs" / "my-shapes.toml").exists():
        assert run(workplace, "b23d init my-shapes", cluster).returncode == 0
        make_small(workplace / "runs" / "my-shapes.toml")
    code = re.sub(r"(b23d\.(?:features|match|keypoints)\([^)]*)\)", r"\1, overrides=FEW)", code)
    code = code.replace("run.scores ", "print(len(run.keypoints)) ")  # no target is annotated here
    code = f"FEW = {FEW!r}\n{code}"
    done = subprocess.run([sys.executable, "-c", code], cwd=workplace, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (workplace / "painted.glb").exists()


def test_the_stage_example_is_a_stage(workplace: Path, cluster: str) -> None:
    """As the README says: a file beside the run file, named in it; in worker processes, too."""
    code = next(block for block in blocks("python") if "@stage" in block)
    (workplace / "runs" / "my_stage.py").write_text(code)
    table = next(block for block in blocks("toml") if "[plugins]" in block)
    head = 'name = "own"\noutputs = ["height", "backproject"]\n'
    data = '[dataset]\nkind = "procedural"\nclasses = ["mug"]\ncount = 2\n'
    (workplace / "runs" / "own.toml").write_text(head + table + data)
    done = run(workplace, "b23d run runs/own.toml --workers 2", cluster)
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    shown = run(workplace, "b23d show runs/own.toml mug/mug-0001 backproject --no-picture", cluster)
    assert "height of mug/mug-0001 (PointFeatures)" in shown.stdout, shown.stdout + shown.stderr


def test_pictures_and_the_notebook_are_there() -> None:
    for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README) + re.findall(r"`(runs/[\w.-]+\.ipynb)`", README):
        assert (ROOT / name).exists() and (ROOT / name).stat().st_size < 900_000, name


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", "\n".join(blocks("sh")), re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target
    ci = (ROOT / ".ci" / "run").read_text()
    assert "make test" in ci
