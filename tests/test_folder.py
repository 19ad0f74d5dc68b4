"""Data set `folder`: any layout of meshes, clouds, materials and keypoints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from b23d.schemas.shape import Source
from b23d.stages.datasets.folder import Folder
from b23d.stages.geometry.companions import image_name, texture_files
from tests.made_datasets import PCD, PLY_MESH, PLY_POINTS, by_name, entry, put, read


def test_folder_of_categories(tmp_path: Path) -> None:
    root = put(tmp_path, {"chair/a.obj": b"v", "chair/deep/b.PLY": PLY_MESH, "table/a.glb": b"g", "table/a.pcd": PCD,
                          "notes.txt": b"", "table/c.xyz": b"0 0 0",
                          ".hidden/x.obj": b"", "chair/.y.obj": b""})  # fmt: skip
    shapes = by_name(Folder(root=root).shapes())
    assert {name: sorted(shape.leaves["source"].files) for name, shape in shapes.items()} == {
        "chair/a": ["mesh.obj"],
        "chair/b": ["mesh.ply"],
        "table/a": ["cloud.pcd", "mesh.glb"],
        "table/c": ["cloud.xyz"],
    }
    assert all(list(shape.leaves) == ["source"] for shape in shapes.values()), "unannotated: no keypoints leaf"
    assert read(shapes["table/a"].leaves["source"]) == Source(
        shape="table/a",
        files={"mesh.glb": b"g", "cloud.pcd": PCD},
        mesh="mesh.glb",
        cloud="cloud.pcd",
        own_names={"mesh.glb": "a.glb", "cloud.pcd": "a.pcd"},
    )


def test_a_flat_folder_is_one_category(tmp_path: Path) -> None:
    root = put(tmp_path / "scans", {"a.stl": b"s", "b.off": b"o"})
    assert list(by_name(Folder(root=root).shapes())) == ["scans/a", "scans/b"]


def test_an_obj_brings_its_materials_and_images(tmp_path: Path) -> None:
    root = put(tmp_path, {
        "chairs/models/a.obj": b"# x\nmtllib a.mtl\nmtllib lost.mtl\nv 0 0 0\n",
        "chairs/models/a.mtl": b"newmtl m\nmap_Kd ..\\images\\Wood 1.JPG\n"
                               b"newmtl n\nmap_Kd -s 2 2 1 -bm 1 gone.png\nmap_Kd K:/abs.png\n",
        "chairs/images/wood 1.jpg": b"jpg", "chairs/models/other.mtl": b"",
    })  # fmt: skip
    (shape,) = Folder(root=root).shapes()
    assert {name: path.name for name, path in shape.leaves["source"].files.items()} == {
        "mesh.obj": "a.obj",
        "a.mtl": "a.mtl",
        "../images/Wood 1.JPG": "wood 1.jpg",
    }


def test_image_names_behind_options() -> None:
    assert image_name(b"-s 1 1 1 -o 0.5 0 my wood.jpg") == b"my wood.jpg"
    assert image_name(b"-clamp on 1.png") == b"1.png"
    assert image_name(b"wood.jpg# Blender MTL File: 'x'") == b"wood.jpg"
    assert texture_files(b"map_Kd a/b.png\nmap_Kd a/b.png\nMAP_KD ../c.png", "sub/m.mtl") == ["sub/a/b.png", "c.png"]


def test_two_files_for_one_shape_name_both(tmp_path: Path) -> None:
    root = put(tmp_path, {"chair/a.obj": b"v", "chair/deep/a.stl": b"s"})
    (shape,) = Folder(root=root).shapes()
    assert shape.name == "chair/a" and shape.error is not None
    assert re.match(
        r"chair/a: expected one mesh, got .*a\.obj and .*a\.stl; rename one, .*dataset.pattern", shape.error
    )
    assert list(by_name(Folder(root=root, pattern="*.obj").shapes())) == ["chair/a"]


def test_a_ply_without_faces_beside_a_mesh_is_its_cloud(tmp_path: Path) -> None:
    (shape,) = Folder(root=put(tmp_path, {"chair/a.obj": b"v", "chair/a.ply": PLY_POINTS})).shapes()
    assert sorted(shape.leaves["source"].files) == ["cloud.ply", "mesh.obj"]


def test_shapenets_layout(tmp_path: Path) -> None:
    root = put(
        tmp_path, {f"03001627/{i}/models/model_normalized.{end}": b"v" for i in ("x1", "x2") for end in ("obj", "ply")}
    )
    shapes = by_name(Folder(root=root, id="folder", pattern="*.obj").shapes())
    assert list(shapes) == ["03001627/x1", "03001627/x2"]


def test_folder_keypoints(tmp_path: Path) -> None:
    entries = [
        entry("a", None),  # the only `a`
        entry("b", "chair"),
        entry("b", "table"),  # told apart by class_id
        entry("lost", "chair"),
        entry("b", "sofa"),  # which b?
        entry("twice"),
        entry("twice"),
        entry("other"),  # a class_id that is no category here
    ]
    names = ["chair/a", "chair/b", "table/b", "chair/twice", "chair/other", "chair/bare"]
    root = put(tmp_path, {f"{name}.obj": b"v" for name in names} | {"keypoints.json": entries})
    shapes = by_name(Folder(root=root).shapes())
    assert sorted(name for name, shape in shapes.items() if "keypoints" in shape.leaves) == sorted(
        set(names) - {"chair/bare"}
    )
    file = f"{root}/keypoints.json"
    assert {name: shape.error for name, shape in shapes.items() if shape.error} == {
        "chair/lost": f"chair/lost: expected a mesh or cloud lost.* below {root}, got none; "
        f"add it, or drop its entry from {file}",
        "sofa/b": f"b: expected class_id among chair, table, which all have such a shape, got 'sofa'; say it in {file}",
        "chair/twice": f"chair/twice: expected one entry in {file}, got several; mend the annotation file",
    }
    assert read(shapes["table/b"].leaves["keypoints"]).ids.tolist() == [4, 7]


def test_folder_keypoints_elsewhere(tmp_path: Path) -> None:
    root = put(tmp_path, {"shapes/chair/a.obj": b"v", "mine.json": [entry("a")]})
    (shape,) = Folder(root=root / "shapes", keypoints=root / "mine.json").shapes()
    assert "keypoints" in shape.leaves
    with pytest.raises(FileNotFoundError, match=r"expected a file .*none.json"):
        Folder(root=root / "shapes", keypoints=root / "none.json").shapes()


def test_folder_as_a_whole_unusable(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"expected a folder .*none.*; set dataset.root"):
        Folder(root=tmp_path / "none").shapes()
    with pytest.raises(FileNotFoundError, match=r"expected files like .*; set dataset.root or dataset.pattern"):
        Folder(root=tmp_path).shapes()


def test_links_are_followed_once(tmp_path: Path) -> None:
    root = put(tmp_path / "root", {"chair/a.obj": b"v"})
    put(tmp_path / "away", {"b.obj": b"v"})
    (root / "table").symlink_to(tmp_path / "away")
    (tmp_path / "away" / "loop").symlink_to(root / "table")
    shapes = by_name(Folder(root=root).shapes())
    assert list(shapes) == ["chair/a", "table/b", "table/loop"]
    assert shapes["table/loop"].error and "got a link back" in shapes["table/loop"].error


@pytest.mark.parametrize("written", ["chair/a", "a.ply", "shapes/chair/a.obj", "shapes\\a"])
def test_an_entry_that_names_a_file_or_class_as_well_is_told_what_was_meant(tmp_path: Path, written: str) -> None:
    put(tmp_path, {"chair/a.ply": PLY_MESH, "keypoints.json": [entry(written, None)]})
    (error,) = [shape.error for shape in Folder(root=tmp_path).shapes() if shape.error]
    assert error.endswith(
        f'model_id "a" in {tmp_path / "keypoints.json"} names it by its file, without folder and suffix'
    )
