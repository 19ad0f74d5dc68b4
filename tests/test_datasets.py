"""Data set `keypointnet`: leaves without paths, keypoints as annotated, bad entries errors of their own shape."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.dataset import DATASETS
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import Source
from b23d.stages.datasets.annotations import load_keypoints
from b23d.stages.datasets.folder import Folder
from b23d.stages.datasets.keypointnet import KeypointNet
from tests.made_datasets import PCD, PLY_MESH, by_name, entry, put, read
from tests.shared_data import shared


def keypointnet(root: Path) -> Path:
    return put(root, {
        "annotations/chair.json": [entry("b"), entry("a"), entry("lost")],
        "annotations/bed.json": [entry("c", "02")],
        "pcds/01/a.pcd": PCD, "pcds/01/b.pcd": PCD, "pcds/02/c.pcd": PCD, "ShapeNetCore.v2.ply/01/a.ply": PLY_MESH,
        "splits/train.txt": "01-a\n", "splits/test.txt": "01-b\n01-lost\n99-zzz\n",
    })  # fmt: skip


# --- KeypointNet -----------------------------------------------------------------------------------------------------


def test_keypointnet_lists_what_is_annotated(tmp_path: Path) -> None:
    shapes = by_name(KeypointNet(root=keypointnet(tmp_path)).shapes())
    assert list(shapes) == ["bed/c", "chair/a", "chair/b", "chair/lost"]
    assert [s.official for s in shapes.values()] == [None, "train", "test", "test"]
    files = [sorted(s.leaves["source"].files) for s in shapes.values() if s.error is None]
    assert files == [["cloud.pcd"], ["cloud.pcd", "mesh.ply"], ["cloud.pcd"]]
    lost = shapes["chair/lost"]
    assert lost.error is not None
    assert lost.error.startswith("chair/lost: expected ShapeNetCore.v2.ply/01/lost.ply or pcds/01/lost.pcd in ")


@pytest.mark.parametrize(
    ("geometry", "files", "errors"),
    [
        ("mesh", ["cloud.pcd", "mesh.ply"], ["bed/c", "chair/b", "chair/lost"]),
        ("cloud", ["cloud.pcd"], ["chair/lost"]),
        ("auto", ["cloud.pcd", "mesh.ply"], ["chair/lost"]),
    ],
)
def test_keypointnet_geometry(tmp_path: Path, geometry: Any, files: list[str], errors: list[str]) -> None:
    shapes = by_name(KeypointNet(root=keypointnet(tmp_path), geometry=geometry).shapes())
    source = read(shapes["chair/a"].leaves["source"])
    assert isinstance(source, Source)
    assert (source.shape, sorted(source.files)) == ("chair/a", files)
    assert (source.mesh, source.cloud) == ("mesh.ply" if "mesh.ply" in files else None, "cloud.pcd")
    assert [name for name, shape in shapes.items() if shape.error] == errors


def test_paths_and_other_shapes_never_enter_a_leaf(tmp_path: Path) -> None:
    """The same bytes elsewhere, under another class's file with other entries, are the same leaf."""
    one = by_name(KeypointNet(root=keypointnet(tmp_path / "here")).shapes())["chair/a"]
    root = put(keypointnet(tmp_path / "there"), {"annotations/chair.json": [entry("a")]})
    other = by_name(KeypointNet(root=root, classes=["chair"]).shapes())["chair/a"]
    for name in ("source", "keypoints"):
        a, b = one.leaves[name], other.leaves[name]
        assert json.dumps(a.values, sort_keys=True) == json.dumps(b.values, sort_keys=True)
        assert {key: path.read_bytes() for key, path in a.files.items()} == {
            key: path.read_bytes() for key, path in b.files.items()
        }
        assert str(tmp_path) not in json.dumps([a.values, list(a.files)])
    assert read(one.leaves["keypoints"]).annotation_file != read(other.leaves["keypoints"]).annotation_file


def test_keypointnet_as_a_whole_unusable(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"expected annotations/<class>\.json in .*; set dataset.root"):
        KeypointNet(root=tmp_path).shapes()
    root = keypointnet(tmp_path)
    with pytest.raises(
        FileNotFoundError, match=r"expected classes among bed, chair in .*, got sofa; set dataset.classes"
    ):
        KeypointNet(root=root, classes=["chair", "sofa"]).shapes()
    bad = {
        "{": "expected JSON",
        "{}": "expected a list",
        "[3]": "expected an object with a string",
        '[{"model_id": "a"}]': "expected a string `class_id`",
    }
    for text, words in bad.items():
        (root / "annotations/chair.json").write_text(text)
        errors = {shape.category: shape.error for shape in KeypointNet(root=root).shapes() if shape.error}
        assert re.search(f"chair.json(?: entry 0)?: {words}.*mend", errors["chair"] or ""), (
            "set aside, and the rest goes on"
        )
        assert any(shape.category == "bed" for shape in KeypointNet(root=root).shapes())


def test_a_model_annotated_twice_is_an_error_of_that_model(tmp_path: Path) -> None:
    root = put(keypointnet(tmp_path), {"annotations/chair.json": [entry("a"), entry("b"), entry("a")]})
    shapes = by_name(KeypointNet(root=root, classes=["chair"]).shapes())
    assert shapes["chair/b"].error is None
    assert "one entry" in (shapes["chair/a"].error or "")


def test_real_keypointnet() -> None:
    """Every annotated point is the cloud's point of its index, symmetries pair mirrored points, and half are of one
    split."""
    shapes = KeypointNet(root=shared("keypointnet")).shapes()
    assert len(shapes) == 134
    assert {shape.official for shape in shapes} == {"train", "val", "test"}
    mirrored = []
    for shape in shapes:
        assert shape.error is None
        keypoints = read(shape.leaves["keypoints"])
        lines = shape.leaves["source"].files["cloud.pcd"].read_text().split("DATA ascii\n")[1].splitlines()
        points = np.array([lines[i].split()[:3] for i in keypoints.point_indices], float)
        np.testing.assert_allclose(points, keypoints.positions, atol=1e-6)
        place = dict(zip(keypoints.ids.tolist(), keypoints.positions, strict=True))
        for group in keypoints.reflections:
            if len(group) == 2:
                a, b = (place[i] for i in group)
                mirrored.append(min(np.linalg.norm(a * flip - b) for flip in 1 - 2 * np.eye(3)))
    assert np.median(mirrored) < 0.02


# --- keypoints -------------------------------------------------------------------------------------------------------


def test_keypoints_as_annotated() -> None:
    made = entry("a")
    values = {"keypoints": made["keypoints"], "symmetries": made["symmetries"], "annotation_file": "abc", "shape": "s"}
    keypoints = load_keypoints({}, values)
    assert isinstance(keypoints, Keypoints)
    assert keypoints.ids.tolist() == [4, 7]
    assert keypoints.positions.tolist() == [[0, 0, 0], [1, 1, 1.5]]
    assert keypoints.point_indices.tolist() == [0, -1]
    assert keypoints.reflections == [(4, 7)], "places in the list, as ids"
    assert keypoints.rotations == []
    assert keypoints.annotation_file == "abc"


GOOD = {"semantic_id": 1, "xyz": [0, 0, 0]}


@pytest.mark.parametrize(
    ("keypoints", "symmetries", "words"),
    [
        (None, None, "expected a list of keypoints, got NoneType"),
        ([3], None, "keypoint 0 of chair/a: expected an object"),
        ([{**GOOD, "semantic_id": None}], None, "whole semantic_id"),
        ([{**GOOD, "semantic_id": 1.5}], None, "whole semantic_id"),
        ([GOOD, {**GOOD, "semantic_id": 2, "xyz": [0, 0]}], None, "keypoint 1 of chair/a: expected xyz"),
        ([{**GOOD, "xyz": [0, 0, "NaN"]}], None, "expected xyz of three finite numbers"),
        ([{**GOOD, "xyz": [0, 0, float("inf")]}], None, "expected xyz of three finite numbers"),
        ([{**GOOD, "pcd_info": {"point_index": -3}}], None, "whole point_index of 0 or more, got -3"),
        ([GOOD, GOOD], None, r"every semantic_id once, got \[1\] more than once"),
        ([{**GOOD, "xyz": [0, 0, 10**400]}], None, "expected xyz of three finite numbers"),
        ([GOOD], {"reflection": [{"kp_indexes": [0, 1]}]}, "list of kp_indexes below 1"),
        ([GOOD], {"rotation": [3]}, "list of kp_indexes below 1"),
        ([GOOD], [3], "list of kp_indexes below 1"),
    ],
)
def test_malformed_entries(keypoints: Any, symmetries: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words) as error:
        load_keypoints({}, {"keypoints": keypoints, "symmetries": symmetries, "shape": "chair/a"})
    assert "chair/a" in str(error.value)
    assert str(error.value).endswith("; mend the annotation file")


def test_nan_in_the_file_is_an_error_of_its_shape_only(tmp_path: Path) -> None:
    root = keypointnet(tmp_path)
    path = root / "annotations/chair.json"
    path.write_text(path.read_text().replace("1.5", "NaN", 1))
    shapes = by_name(KeypointNet(root=root).shapes())
    json.dumps(shapes["chair/b"].leaves["keypoints"].values, allow_nan=False)  # an address can be made of it
    with pytest.raises(ValueError, match=r"keypoint 1 of chair/b: expected xyz of three finite numbers, got .*NaN"):
        read(shapes["chair/b"].leaves["keypoints"])
    assert read(shapes["chair/a"].leaves["keypoints"]).ids.tolist() == [4, 7]


def test_colors_and_faces_of_keypoints_do_not_enter_the_leaf(tmp_path: Path) -> None:
    root = keypointnet(tmp_path)
    before = by_name(KeypointNet(root=root).shapes())["chair/a"].leaves["keypoints"].values
    path = root / "annotations/chair.json"
    path.write_text(
        path.read_text().replace(
            '"semantic_id": 4', '"rgb": [1, 2, 3], "mesh_info": {"face_index": 4}, "semantic_id": 4'
        )
    )
    assert by_name(KeypointNet(root=root).shapes())["chair/a"].leaves["keypoints"].values == before


def test_an_entry_without_symmetries_is_fine() -> None:
    assert load_keypoints({}, {"keypoints": [GOOD], "symmetries": None}).reflections == []
    assert load_keypoints({}, {"keypoints": []}).ids.shape == (0,)


def test_both_are_declared() -> None:
    assert DATASETS["keypointnet"] is KeypointNet
    assert DATASETS["folder"] is Folder
