"""Procedural shapes: keypoints on the surface, exact symmetry, closed parts, real variation, the same bytes everywhere."""

from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from stages.datasets.procedural import Procedural, _model, load_keypoints, load_parts, load_source

CLASSES = ("chair", "table", "airplane", "mug")
SAMPLE = [(category, index) for category in CLASSES for index in range(8)]


def values(category: str, index: int) -> dict[str, object]:
    return {"class": category, "seed": 0, "index": index, "version": 1}


@pytest.mark.parametrize(("category", "index"), SAMPLE)
def test_keypoints_lie_on_the_surface(category: str, index: int) -> None:
    model = _model(values(category, index))
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=False)
    distance = trimesh.proximity.closest_point_naive(mesh, model.keypoints)[1]
    assert distance.max() < 1e-6 * np.linalg.norm(mesh.extents), dict(zip(model.keypoint_ids.tolist(), distance.round(5), strict=True))


@pytest.mark.parametrize(("category", "index"), SAMPLE)
def test_shape_and_keypoints_are_their_own_mirror_image(category: str, index: int) -> None:
    model = _model(values(category, index))
    flip = np.array([-1.0, 1.0, 1.0])
    assert {tuple(v) for v in model.vertices + 0.0} == {tuple(v) for v in model.vertices * flip.astype(np.float32) + 0.0}
    places = dict(zip(model.keypoint_ids.tolist(), model.keypoints, strict=True))
    for one, other in model.reflections:
        np.testing.assert_array_equal(places[one] * flip, places[other])
    exchanged = {i for pair in model.reflections for i in pair}
    assert all(place[0] == 0 for i, place in places.items() if i not in exchanged)


@pytest.mark.parametrize(("category", "index"), SAMPLE[::2])
def test_every_part_is_closed_and_turned_outwards(category: str, index: int) -> None:
    model = _model(values(category, index))
    for part in trimesh.Trimesh(model.vertices, model.faces, process=False).split(only_watertight=False):
        assert part.is_watertight
        assert part.volume > 0


@pytest.mark.parametrize("category", CLASSES)
def test_shapes_vary_and_so_do_their_keypoints(category: str) -> None:
    models = [_model(values(category, index)) for index in range(24)]
    assert len({tuple(sorted(model.style.items())) for model in models}) >= 8
    assert len({tuple(model.keypoint_ids) for model in models}) >= 2, "some ids are absent on some shapes"
    assert len({len(model.part_names) for model in models}) == 1
    assert all(set(np.unique(model.face_labels)) <= set(range(len(model.part_names))) for model in models)
    assert all(6 <= len(model.keypoint_ids) <= 16 for model in models)


def test_a_larger_count_changes_no_earlier_shape() -> None:
    few, many = (Procedural(kind="procedural", count=n).shapes() for n in (2, 5))
    leaves = {shape.name: shape.leaves["source"].values for shape in many}
    assert all(leaves[shape.name] == shape.leaves["source"].values for shape in few)
    assert len(few) == 8 and len(many) == 20


def test_leaves_agree() -> None:
    source, keypoints, parts = (load({}, values("chair", 3)) for load in (load_source, load_keypoints, load_parts))
    mesh = trimesh.load(trimesh.util.wrap_as_stream(source.files["mesh.ply"]), file_type="ply", process=False)
    assert len(mesh.faces) == len(parts.labels)
    np.testing.assert_allclose(mesh.triangles_center, parts.points, atol=1e-6)
    assert keypoints.positions.dtype == np.float64


def test_the_bytes_are_the_same_in_another_process() -> None:
    here = hashlib.sha256(b"".join(load_source({}, values(c, 1)).files["mesh.ply"] for c in CLASSES)).hexdigest()
    code = (
        "import hashlib; from stages.datasets.procedural import load_source; v = lambda c: {'class': c, 'seed': 0, 'index': 1};"
        f"print(hashlib.sha256(b''.join(load_source({{}}, v(c)).files['mesh.ply'] for c in {CLASSES})).hexdigest())"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == here
