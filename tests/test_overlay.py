"""Exports lie over the file they came from, and are never taken for shapes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from b23d.pipeline.inspection.artifact import export_artifact
from b23d.pipeline.run import Run
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from tests.small_runs import FAST, b23d

AT, SCALE = np.array([300.0, -20.0, 70.0]), 40.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Three textured boxes in millimetres, far from the origin; two are annotated."""
    folder = tmp_path_factory.mktemp("overlay")
    box = folder / "shapes" / "box"
    box.mkdir(parents=True)
    Image.fromarray(np.full((4, 4, 3), (10, 200, 30), np.uint8)).save(box / "green.png")
    (box / "green.mtl").write_text("newmtl green\nKd 1 1 1\nmap_Kd green.png\n")
    entries = []
    for i in range(3):
        mesh = trimesh.creation.box(extents=(1, 0.5 + 0.1 * i, 0.8)).subdivide()
        lines = ["mtllib green.mtl", "vt 0.2 0.2", "vt 0.8 0.2", "vt 0.2 0.8", "usemtl green"]
        lines += ["v {} {} {}".format(*at) for at in mesh.vertices * SCALE + AT]
        lines += ["f {}/1 {}/2 {}/3".format(*face) for face in mesh.faces + 1]
        (box / f"b{i}.obj").write_text("\n".join(lines))
        corners = trimesh.creation.box(extents=(1, 0.5 + 0.1 * i, 0.8)).vertices * SCALE + AT
        marks = [{"xyz": at.tolist(), "semantic_id": k} for k, at in enumerate(corners)]
        entries.append({"model_id": f"b{i}", "keypoints": marks})
    (folder / "shapes" / "keypoints.json").write_text(json.dumps(entries[:2]))
    path = folder / "boxes.toml"
    path.write_text(
        f'name = "boxes"\n[dataset]\nkind = "folder"\nroot = "shapes"\n[shots]\ncount = 2\ndraws = [0]\n'
        f'[store]\nroot = "{folder / "store"}"\n' + FAST
    )
    loaded = Run.load(path)
    assert loaded.execute(workers=0).ok
    return loaded


def vertices_of(run: Run, shape: str) -> np.ndarray:
    file = run.config.path.parent / "shapes" / f"{shape}.obj"
    lines = [line.split() for line in file.read_text().splitlines()]
    return np.array([line[1:] for line in lines if line[0] == "v"], float)


@pytest.mark.parametrize("suffix", ["ply", "glb", "obj"])
def test_geometry_and_keypoints_lie_over_the_file(run: Run, tmp_path: Path, suffix: str) -> None:
    (path, *_) = export_artifact(run, "box/b2", "optimize", None, tmp_path / "new" / f"k.{suffix}")
    whole = trimesh.load(path, force="mesh", process=False)
    file = vertices_of(run, "box/b2")
    np.testing.assert_allclose(whole.bounds, np.stack([file.min(0), file.max(0)]), atol=0.013 * SCALE)
    prediction = run.artifact("box/b2", "optimize")
    shape = run.artifact("box/b2", "normalize")
    assert isinstance(prediction, Prediction) and isinstance(shape, NormalizedShape)
    far = np.linalg.norm(whole.vertices[:, None] - shape.to_source(prediction.positions)[None], axis=2).min(0)
    np.testing.assert_allclose(far, 0.012 * SCALE, rtol=0.05, err_msg="a ball of radius .012 of the longest side")


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_the_texture_comes_along(run: Run, tmp_path: Path, suffix: str) -> None:
    for extra in ((), ("stages.normalize.watertight=true", "stages.normalize.watertight_resolution=16")):
        other = Run.load(run.config.path, extra)
        other.execute(workers=0)
        (path, *beside) = export_artifact(other, "box/b2", "optimize", None, tmp_path / f"t{len(extra)}.{suffix}")
        assert sorted(p.suffix for p in beside) == ([".mtl", ".png"] if suffix == "obj" else [])
        scene = trimesh.load(path, process=False)
        assert isinstance(scene, trimesh.Scene)
        textured = [g for g in scene.geometry.values() if getattr(g.visual, "uv", None) is not None]
        assert len(textured) == 1 and len(textured[0].faces) == 48, "the file's own surface, watertight run or not"
        material = textured[0].visual.material
        image = getattr(material, "baseColorTexture", None) or material.image
        assert tuple(np.asarray(image.convert("RGB"))[0, 0]) == (10, 200, 30)


def test_the_unit_frame_is_there_for_the_asking(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "n.ply"
    b23d("show", str(run.config.path), "box/b2", "normalize", "--export", str(path), "--frame", "unit")
    assert np.ptp(trimesh.load(path).vertices, axis=0).max() == pytest.approx(1)
    b23d("show", str(run.config.path), "box/b2", "normalize", "--export", str(path))
    assert np.ptp(trimesh.load(path).vertices, axis=0).max() == pytest.approx(SCALE)
    with pytest.raises(ValueError, match=r"expected one of \.glb, \.npz, \.obj, \.parquet, \.ply, \.png, got '\.xyz'"):
        export_artifact(run, "box/b2", "normalize", None, tmp_path / "n.xyz")


def test_arrays_carry_the_points_they_are_at(run: Run, tmp_path: Path) -> None:
    shape, features = run.artifact("box/b2", "normalize"), run.artifact("box/b2", "reweight")
    distances = run.artifact("box/b2", "geodesic")
    assert isinstance(shape, NormalizedShape) and isinstance(features, PointFeatures)
    assert isinstance(distances, GeodesicDistances)
    export_artifact(run, "box/b2", "reweight", None, tmp_path / "f.npz")
    export_artifact(run, "box/b2", "geodesic", None, tmp_path / "d.npz", "unit")
    export_artifact(run, "box/b2", "normalize", None, tmp_path / "n.npz")
    f, d, n = (np.load(tmp_path / f"{name}.npz") for name in "fdn")
    np.testing.assert_allclose(f["points"], shape.to_source(shape.points))
    np.testing.assert_array_equal(f["features"], features.features)
    np.testing.assert_array_equal(d["points"], shape.points)
    np.testing.assert_array_equal(d["distances"], distances.distances)
    np.testing.assert_allclose(n["vertices"], vertices_of(run, "box/b2"), atol=1e-4)
    assert json.loads(str(f["fields"]))["frame"] == "file" and json.loads(str(d["fields"]))["frame"] == "unit"


def test_lengths_follow_the_frame(run: Run, tmp_path: Path) -> None:
    distances = run.artifact("box/b2", "geodesic")
    assert isinstance(distances, GeodesicDistances)
    export_artifact(run, "box/b2", "geodesic", None, tmp_path / "d.npz")
    np.testing.assert_allclose(np.load(tmp_path / "d.npz")["distances"], distances.distances.astype(float) * SCALE)


def test_exports_among_the_shapes_are_no_shapes(run: Run) -> None:
    """In the data set's own folder an export is called `.b23d.`, and the next run has the shapes it had."""
    folder = run.config.path.parent / "shapes" / "box"
    before = [shape.name for shape in run.shapes]
    try:
        for suffix in ("ply", "glb", "obj", "npz"):
            stage = "optimize" if suffix == "obj" else "reweight"
            out = str(folder / f"out.{suffix}")
            said = b23d("show", str(run.config.path), "box/b2", stage, "--export", out)
            assert f"out.b23d.{suffix}" in said.replace("\n", "") and (folder / f"out.b23d.{suffix}").exists()
            assert not (folder / f"out.{suffix}").exists()
        assert [shape.name for shape in Run.load(run.config.path).shapes] == before
        b23d("keypoints", str(run.config.path), "--shape", "b2", "-o", str(folder / "k.ply"))
        assert [shape.name for shape in Run.load(run.config.path).shapes] == before
        assert "b23d export" in (folder / "out.b23d.ply").read_bytes()[:200].decode("ascii", "replace")
    finally:
        for path in folder.glob("*.b23d*"):
            path.unlink()
