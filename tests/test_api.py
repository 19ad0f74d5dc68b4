"""The Python API: one line each, on whatever holds a shape."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import b23d
from b23d.pipeline.run import Run
from b23d.stages.datasets.given import arrays_of
from b23d.stages.datasets.procedural.figures import WAVING, figure
from b23d.stages.workbench.api.guard import unguarded_script
from tests.small_runs import FAST, make_boxes
from tests.small_runs import b23d as command

FEW = ["stages.normalize.count=256", "stages.render.rings.count=1", "stages.render.resolution=64"]
BOX = trimesh.creation.box((1, 2, 4)).subdivide()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_way_to_hold_a_shape_is_the_same_shape(here: Path) -> None:
    """A trimesh object, an open3d-style one and arrays have one address; a second call computes nothing."""
    open3d = SimpleNamespace(vertices=BOX.vertices.tolist(), triangles=BOX.faces.astype(np.int64))
    first = b23d.features(BOX, overrides=FEW)
    assert first.shape[0] == len(BOX.vertices) and first.dtype == np.float32 and np.isfinite(first).all()
    made = len(list((here / "runs" / ".store" / "reweight").glob("*/*")))
    for thing in (open3d, (BOX.vertices, BOX.faces)):
        np.testing.assert_array_equal(b23d.features(thing, overrides=FEW), first)
    assert len(list((here / "runs" / ".store" / "reweight").glob("*/*"))) == made == 1


def test_descriptors_are_in_the_file_s_vertex_order_and_a_run_s_store_is_shared(here: Path) -> None:
    order = np.random.default_rng(0).permutation(len(BOX.vertices))
    shuffled = trimesh.Trimesh(BOX.vertices[order], np.argsort(order)[BOX.faces], process=False)
    (here / "a.ply").write_bytes(trimesh.exchange.ply.export_ply(BOX, vertex_normal=False))
    (here / "b.ply").write_bytes(trimesh.exchange.ply.export_ply(shuffled, vertex_normal=False))
    a, b = (b23d.features(here / name, overrides=FEW) for name in ("a.ply", "b.ply"))
    np.testing.assert_allclose(b, a[order], atol=0.2 * np.abs(a).max())
    at = b23d.features(str(here / "a.ply"), points=BOX.vertices[:5], overrides=FEW)
    np.testing.assert_allclose(at, a[:5], atol=1e-4)


def test_a_cloud_has_a_descriptor_a_point(here: Path) -> None:
    points = trimesh.creation.icosphere(subdivisions=3).vertices * [1, 0.5, 0.7]
    for thing in (points, SimpleNamespace(points=points)):
        assert b23d.features(thing, overrides=FEW).shape[0] == len(points)


@pytest.mark.parametrize(
    ("thing", "error", "message"),
    [
        ("nowhere.ply", FileNotFoundError, "mesh: expected a mesh or cloud, got no file at"),
        (".", FileNotFoundError, "mesh: expected a mesh or cloud, got a folder"),
        (np.zeros((4, 2)), ValueError, r"mesh: expected vertices \(v, 3\), got an array of shape \(4, 2\)"),
        ((np.zeros((3, 3)), np.array([[0, 1, 7]])), ValueError, "its 3 vertices, counted from 0, got index 7"),
        (object(), TypeError, "mesh: expected a path, a mesh or arrays, got object"),
        ((np.zeros((3, 3)), np.array([[0, 1, 2]])), RuntimeError, "2 distinct points"),
    ],
)
def test_what_is_no_shape_is_said(here: Path, thing: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        b23d.features(thing, overrides=FEW)


def test_colours_come_along() -> None:
    painted = BOX.copy()
    painted.visual.vertex_colors = np.tile([10, 20, 30, 255], (len(BOX.vertices), 1))
    assert arrays_of(painted)[2].tolist() == [[10, 20, 30]] * len(BOX.vertices)
    open3d = SimpleNamespace(points=BOX.vertices, colors=np.full(BOX.vertices.shape, 0.5))
    assert arrays_of(open3d)[2].tolist() == [[128] * 3] * len(BOX.vertices)
    assert arrays_of((BOX.vertices, BOX.faces))[2] is None


def test_a_shape_matches_itself_and_takes_its_own_colours(here: Path) -> None:
    """Of itself every vertex finds a point near it (a quarter of the shape's size at most, in the median far less)."""
    rough = trimesh.creation.icosphere(subdivisions=3)
    rough.vertices *= np.random.default_rng(0).uniform(0.8, 1.2, (len(rough.vertices), 1))
    rough.vertices[:, 0] *= 3
    colors = np.where(rough.vertices[:, :1] > 0, [[250, 10, 10]], [[10, 10, 250]]).astype(np.uint8)
    rough.visual.vertex_colors = np.hstack([colors, np.full((len(colors), 1), 255, np.uint8)])
    found = b23d.match(rough, rough, overrides=["stages.normalize.count=642", "stages.render.rings.count=3"])
    away = np.linalg.norm(found.points - rough.vertices, axis=1) / np.ptp(rough.vertices, axis=0).max()
    assert np.median(away) < 0.05 and (np.abs(found.colors.astype(int) - colors).max(1) < 60).mean() > 0.8
    assert found.similarity.max() <= 1.0001 and np.median(found.similarity) > 0.8
    assert found.mesh().vertices.shape == rough.vertices.shape


def test_two_poses_match_as_bodies(here: Path) -> None:
    """What corresponds is known: vertex i is the same place of the body in every pose."""
    standing, waving = figure(), figure(WAVING)
    a, b = ((solid.vertices, solid.faces) for solid in (standing, waving))
    few = ["stages.normalize.count=500", "stages.render.rings.count=2"]
    away = {
        how: np.linalg.norm(b23d.match(a, b, method=how, overrides=few).points - waving.vertices, axis=1)  # type: ignore[arg-type]
        for how in ("nearest", "smooth")
    }
    assert np.median(away["smooth"]) < 0.1 and away["smooth"].mean() < away["nearest"].mean()
    with pytest.raises(ValueError, match="method: expected one of 'nearest', 'consistent', 'smooth', got 'looks'"):
        b23d.match(a, b, method="looks")  # type: ignore[arg-type]


def test_match_on_the_command_line(here: Path) -> None:
    for name, sides in (("a", (1, 2, 4)), ("b", (1.2, 2, 3.5))):
        trimesh.creation.box(sides).subdivide().export(here / f"{name}.ply")
    sets = [word for text in FEW for word in ("--set", text)]
    output = command("match", "a.ply", "b.ply", "-o", "new/painted.ply", *sets)
    assert "wrote new/painted.ply" in output and "26 vertices matched" in output
    painted = trimesh.load(here / "new" / "painted.ply", process=False)
    np.testing.assert_allclose(painted.vertices, trimesh.load(here / "a.ply", process=False).vertices, atol=1e-6)
    page = (here / "new" / "painted.html").read_text()
    assert "colours of what looks alike" in page and "<script src=" not in page
    command("match", "a.ply", "b.ply", "-o", "painted.glb", "--method", "consistent", *sets)
    assert "would drop 0 artifacts" in command("gc", "--dry-run"), "what it stored is kept, and gc goes through"
    with pytest.raises(ValueError, match=r"expected a file of \.ply or \.glb"):
        command("match", "a.ply", "b.ply", "-o", "painted.stl", *sets)


@pytest.mark.parametrize("shots", [2, ["b0", "b1"], {"box": ["b0", "b1"]}, None])
def test_keypoints_of_a_folder_in_one_call(here: Path, shots: object) -> None:
    make_boxes(here, 4)
    entries = json.loads((here / "shapes" / "keypoints.json").read_text())
    (here / "shapes" / "keypoints.json").write_text(json.dumps(entries[:2]))
    table = b23d.keypoints("shapes", shots, overrides=[*FEW], store=str(here / "store"), workers=0)  # type: ignore[arg-type]
    assert set(table["shape"]) == {"b2", "b3"} and len(table) == 16 and "draw" not in table


def test_unannotated_folders_are_said(here: Path) -> None:
    make_boxes(here, 2)
    (here / "shapes" / "keypoints.json").unlink()
    with pytest.raises(ValueError, match="expected annotated shapes, got 2 without; b23d init and b23d annotate"):
        b23d.keypoints("shapes")


SCRIPT = """
import b23d
run = b23d.load({path!r})
report = run.execute({arguments})
print("made", len(report.done), report.ok)
"""


def script(folder: Path, arguments: str, guarded: bool) -> subprocess.CompletedProcess[str]:
    code = SCRIPT.format(path=str(folder / "boxes.toml"), arguments=arguments)
    if guarded:
        code = 'if __name__ == "__main__":\n' + "\n".join(f"    {line}" for line in code.splitlines())
    (folder / "script.py").write_text(code)
    return subprocess.run([sys.executable, "script.py"], cwd=folder, capture_output=True, text=True)


def test_a_script_without_a_guard_runs_in_its_own_process_and_says_so(here: Path) -> None:
    make_boxes(here, 3)
    done = script(here, "", guarded=False)
    assert done.returncode == 0 and "True" in done.stdout, done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("b23d: running in this process alone") and 'if __name__ == "__main__":' in line
    asked = script(here, "workers=2", guarded=False)
    assert asked.returncode == 1 and "expected a script that workers can import" in asked.stderr
    assert len(asked.stderr.splitlines()) < 15
    assert script(here, "workers=2", guarded=True).stdout.startswith("made 0 True"), "all is there"


def test_a_guard_is_seen(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text, found in (("if __name__ == '__main__':\n", False), ("print(1)\n", True), ("x = '__main__'\n", True)):
        (here / "s.py").write_text(text)
        monkeypatch.setitem(sys.modules, "__main__", SimpleNamespace(__file__=str(here / "s.py"), __spec__=None))
        assert (unguarded_script() is not None) == found, text
    monkeypatch.setitem(sys.modules, "__main__", SimpleNamespace(__spec__=None))
    assert unguarded_script() is None, "a notebook"


def test_a_run_and_a_plan_say_what_they_are(here: Path) -> None:
    path = make_boxes(here, 3)
    run = b23d.load(path)
    assert (
        repr(run) == "<b23d run boxes: 3 shapes of box (folder); 1 draw of 2 shots; outputs reweight, optimize, score>"
    )
    words = repr(run.plan())
    assert words.startswith("<plan: normalize 3 to run; ") and len(words) < 400
    assert "<table>" in run._repr_html_() and "3 to run" in run._repr_html_()
    assert isinstance(run, Run)
    assert FAST
