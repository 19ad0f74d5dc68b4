"""One bad directory entry, or one bad entry of an annotation file, is set aside by name; the rest goes on."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import pytest

import b23d
from b23d.pipeline.run import Run
from b23d.stages.datasets.annotations import AnnotationFile
from b23d.stages.datasets.folder import Folder
from b23d.stages.datasets.keypointnet import KeypointNet
from b23d.stages.datasets.names import keypoint_label, keypoint_names
from b23d.stages.datasets.shapenetpart import ShapeNetPart
from b23d.stages.datasets.walking import walk
from b23d.stages.geometry.loading import load
from tests.made_datasets import PCD, PLY_MESH, by_name, entry, put
from tests.small_runs import make_boxes


def spoil(folder: Path, suffix: str) -> None:
    """Every strange entry we know of, each looking like a shape's file."""
    os.mkfifo(folder / f"pipe{suffix}")
    (folder / f"dangling{suffix}").symlink_to("nowhere")
    (folder / f"circle{suffix}").symlink_to(folder / f"circle{suffix}")
    (folder / f"device{suffix}").symlink_to("/dev/zero")
    Path(os.fsdecode(os.fsencode(folder) + b"/caf\xe9" + suffix.encode())).write_bytes(b"v")
    (folder / f"._apple{suffix}").write_bytes(b"Mac OS X")
    (folder / ".hidden").mkdir()
    (folder / ".hidden" / f"x{suffix}").write_bytes(b"v")
    with socket.socket(socket.AF_UNIX) as opened:
        here = Path.cwd()
        try:
            os.chdir(folder)  # a socket's path must be short
            opened.bind(f"socket{suffix}")
        finally:
            os.chdir(here)


STRANGE = {"pipe", "dangling", "circle", "device", "caf\\xe9", "socket"}


def test_a_folder_goes_on(tmp_path: Path) -> None:
    root = put(
        tmp_path / "root", {"chair/a.PLY": PLY_MESH, "chair/deep/b.obj": b"v", "chair/b.stl": b"s", "chair/c.obj": b""}
    )
    spoil(root / "chair", ".obj")
    (root / "chair" / "up").symlink_to(root)
    (root / "empty").mkdir()
    put(root, {"__MACOSX/chair/._a.PLY": b"Mac OS X", "__MACOSX/chair/a.PLY": PLY_MESH})
    put(root, {"pictures/wood.png": b"p", "readme/notes.txt": b"", "deep/x.gltf": "[" * 50_000})
    shapes = by_name(Folder(root=root).shapes())
    errors = {name: shape.error for name, shape in shapes.items() if shape.error}
    assert [name for name in shapes if name not in errors] == ["chair/a", "chair/c", "deep/x"]
    with pytest.raises(ValueError, match=r"^deep/x: x\.gltf: JSON: expected glTF's, got RecursionError"):
        load("deep/x", {"x.gltf": (root / "deep" / "x.gltf").read_bytes()}, "x.gltf")
    assert errors.keys() == {f"chair/{name}" for name in STRANGE} | {
        "chair/b", "chair/up", "empty/(no shapes)", "readme/(no shapes)",
    }  # fmt: skip
    assert "pipe, socket or device" in errors["chair/pipe"] and "link to nothing" in errors["chair/dangling"]
    assert "got a link back to" in errors["chair/up"] and "UTF-8" in errors["chair/caf\\xe9"]
    assert all(text.encode() for text in errors.values()), "every message can be printed"


def test_a_folder_of_bad_entries_alone_names_them(tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    spoil(tmp_path / "root", ".glb")
    shapes = Folder(root=tmp_path / "root").shapes()
    assert {shape.id for shape in shapes} == STRANGE and all(shape.error for shape in shapes)


def test_a_folder_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = put(tmp_path, {"chair/a.obj": b"v", "closed/b.obj": b"v"})
    scan = os.scandir

    def refusing(path: str) -> object:
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied")
        return scan(path)

    monkeypatch.setattr(os, "scandir", refusing)
    errors = {shape.name: shape.error for shape in Folder(root=root).shapes()}
    assert errors["chair/a"] is None and len(errors) == 2
    assert "Permission denied" in next(text for text in errors.values() if text)


def test_keypointnet_goes_on(tmp_path: Path) -> None:
    files = {f"pcds/01/{name}": PCD for name in ("a.pcd", "B.PCD", "._a.pcd")}
    root = put(tmp_path, {
        **files, "annotations/chair.json": [entry("a"), 7, entry("B"), {"keypoints": []}, {"model_id": ["x"]}],
        "annotations/deep.json": "[" * 100_000, "annotations/none.json": [], "annotations/._chair.json": b"\x00",
        "splits/train.txt": b"01-a\n\xff\xfe\n",
    })  # fmt: skip
    os.mkfifo(root / "annotations" / "pipe.json")
    spoil(root / "pcds" / "01", ".pcd")
    shapes = by_name(KeypointNet(root=root).shapes())
    assert [name for name, shape in shapes.items() if not shape.error] == ["chair/B", "chair/a"]
    assert {name for name, shape in shapes.items() if shape.error} == {
        "chair/entry 1", "chair/entry 3", "chair/entry 4", "deep/(no shapes)", "none/(no shapes)", "pipe/(no shapes)",
    }  # fmt: skip
    assert "nested too deep" in str(shapes["deep/(no shapes)"].error)


def test_shapenetpart_goes_on(tmp_path: Path) -> None:
    row = "0 0 0 0 0 1 36\n"
    root = put(
        tmp_path, {"synsetoffset2category.txt": "Mug\t03797390\nBag\t02773838\nTeapot\t1\n", "03797390/a.TXT": row}
    )
    (root / "02773838").mkdir()
    (root / "1").mkdir()
    spoil(root / "03797390", ".txt")
    shapes = by_name(ShapeNetPart(root=root).shapes())
    assert [name for name, shape in shapes.items() if not shape.error] == ["Mug/a"]
    assert {name for name, shape in shapes.items() if shape.error} == {f"Mug/{name}" for name in STRANGE} | {
        "Bag/(no shapes)", "Teapot/(no shapes)",
    }  # fmt: skip


def test_external_files_go_on(tmp_path: Path) -> None:
    root = put(tmp_path / "root", {"chair/a.obj": b"v", "chair/pipe.obj": b"v"})
    away = put(tmp_path / "away", {"a.npz": b"n"})
    spoil(away, ".npz")
    shapes = by_name(Folder(root=root, external_features=away).shapes())
    assert all(shape.error is None for shape in shapes.values())
    with pytest.raises(ValueError, match=r"chair/pipe: external_features: pipe\.npz: .*pipe, socket or device"):
        shapes["chair/pipe"].leaves["external_features"].read()


def test_a_broken_annotation_file_of_a_folder_costs_no_shape(tmp_path: Path) -> None:
    root = put(tmp_path, {"chair/a.obj": b"v"})
    path = root / "keypoints.json"
    for text in ("[" * 100_000, "{", "{}", '"x"', "[{]", "\x00"):
        path.write_text(text)
        shapes = by_name(Folder(root=root).shapes())
        assert shapes["chair/a"].error is None and len(shapes) == 2
        assert shapes[f"{root.name}/keypoints.json"].error
    path.unlink()
    os.mkfifo(path)
    assert any(shape.error for shape in Folder(root=root).shapes()), "never opened"
    path.unlink()
    path.write_text(json.dumps([3, {"model_id": "\ud800"}, entry("a")]))
    shapes = by_name(Folder(root=root).shapes())
    assert "keypoints" in shapes["chair/a"].leaves
    assert {shape.id for shape in shapes.values() if shape.error} == {
        "keypoints.json entry 0",
        "keypoints.json entry 1",
    }


@pytest.mark.parametrize("text", ["{bad", "{}", "[3]", '"x"', None])
def test_a_bad_annotation_file_is_one_failure_that_says_its_path_once(tmp_path: Path, text: str | None) -> None:
    path = make_boxes(tmp_path, 2)
    file = tmp_path / "shapes" / "keypoints.json"
    file.unlink()
    if text is None:
        file.mkdir()
    else:
        file.write_text(text)
    (problem,) = Run.load(path).plan().problems
    assert problem.error.count("keypoints.json") == 1 and problem.error.startswith(str(file)), problem.error
    assert "annotate shapes" not in problem.error
    with pytest.raises(ValueError, match=r"keypoints\.json.*: expected (JSON|a list|an object|a file)"):
        b23d.keypoints(tmp_path / "shapes", store=str(tmp_path / "store"))
    file.rmdir() if text is None else file.write_text("[]")
    (problem,) = Run.load(path).plan().problems
    assert "annotate shapes" in problem.error, "where nothing is wrong with the file"


def test_links_are_followed_once_and_never_back(tmp_path: Path) -> None:
    root = put(tmp_path / "root", {"chair/a.obj": b"v"})
    put(tmp_path / "away", {"b.obj": b"v"})
    for name in ("one", "two"):
        (root / name).symlink_to(tmp_path / "away")
    listing = walk(root)
    assert sorted(listing.files.values()) in (["chair/a.obj", "one/b.obj"], ["chair/a.obj", "two/b.obj"])
    assert not listing.closed and not listing.strange


def test_twenty_thousand_keypoints_are_read_in_linear_work(tmp_path: Path) -> None:
    keypoints = [{"semantic_id": i, "xyz": [i, 0, 0]} for i in range(20_000)]
    path = put(tmp_path, {"k.json": [{"model_id": "a", "keypoints": keypoints}]}) / "k.json"
    file = AnnotationFile.read(path)

    class Counted(int):
        compared = 0

        def __eq__(self, other: object) -> bool:
            Counted.compared += 1
            return int(self) == other

        __hash__ = int.__hash__

    for keypoint in file.entries[0]["keypoints"]:
        keypoint["semantic_id"] = Counted(keypoint["semantic_id"])
    read = file.leaf(file.entries[0], "c/a").read()
    assert len(read.ids) == 20_000 and Counted.compared < 20 * 20_000  # type: ignore[attr-defined]


def test_names_live_beside_ids_and_change_no_address(tmp_path: Path) -> None:
    one, other = entry("a"), entry("b")
    plain = put(tmp_path / "p", {"c/a.obj": b"v", "c/b.obj": b"v", "keypoints.json": [entry("a"), entry("b")]})
    one["keypoints"][0]["name"], other["keypoints"][0]["name"] = " left  tip ", "tip"
    one["keypoints"][1]["name"] = 3
    named = put(tmp_path / "n", {"c/a.obj": b"v", "c/b.obj": b"v", "keypoints.json": [one, other]})
    before, after = Folder(root=plain).shapes(), Folder(root=named).shapes()
    assert [s.leaves["keypoints"].values for s in before] == [s.leaves["keypoints"].values for s in after]
    assert after[0].leaves["keypoints"].read().names == {4: "left tip"}  # type: ignore[attr-defined]
    assert keypoint_names(before) == {} and keypoint_names(after) == {"c": {4: "left tip"}}
    assert keypoint_label(4, keypoint_names(after)["c"]) == "4 (left tip)" and keypoint_label(7, {}) == "7"
