"""ShapeNetPart's layout, on files made in that form."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from b23d.stages.datasets.shapenetpart import LABELS, ShapeNetPart
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_datasets import by_name, put, read

SYNSETS = {"Laptop": "03642806", "Mug": "03797390", "Airplane": "02691156"}


def rows(seed: int, labels: range, n: int = 300) -> str:
    """Two boxes, one above the other; the first label below, the last above."""
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (n, 3)) * np.array([1, 0.3 + 0.05 * seed, 0.6])
    above = points[:, 1] > 0
    table = np.column_stack([points, np.tile([0, 1, 0], (n, 1)), np.where(above, labels[-1], labels[0])])
    return "".join("{:.5f} {:.5f} {:.5f} {:.4f} {:.4f} {:.4f} {:.6f}\n".format(*row) for row in table)


def make_shapenetpart(root: Path, count: int = 3) -> Path:
    """`count` laptops and mugs; the last of each is the test split. Airplanes are named but have no folder."""
    files = {"synsetoffset2category.txt": "".join(f"{name}\t{synset}\n" for name, synset in SYNSETS.items())}
    splits: dict[str, list[str]] = {"train": [], "val": [], "test": []}
    for category in ("Laptop", "Mug"):
        for i in range(count):
            files[f"{SYNSETS[category]}/m{i}.txt"] = rows(i, LABELS[category])
            splits["test" if i == count - 1 else "train"].append(f"shape_data/{SYNSETS[category]}/m{i}")
    for split, names in splits.items():
        files[f"train_test_split/shuffled_{split}_file_list.json"] = json.dumps(names)
    return put(root, files)  # type: ignore[arg-type]


def test_shapes_splits_and_leaves(tmp_path: Path) -> None:
    shapes = by_name(ShapeNetPart(root=make_shapenetpart(tmp_path)).shapes())
    assert list(shapes) == [f"{c}/m{i}" for c in ("Laptop", "Mug") for i in range(3)]
    assert [shapes[f"Mug/m{i}"].official for i in range(3)] == ["train", "train", "test"]
    parts, source = read(shapes["Mug/m1"].leaves["parts"]), read(shapes["Mug/m1"].leaves["source"])
    assert set(parts.labels.tolist()) == {0, 1}
    assert parts.names == ["36", "37"]
    assert parts.points.shape == (300, 3)
    shape = normalize(source, NormalizeParams())
    assert shape.kind == "cloud"
    assert shape.candidates == "cloud"
    assert np.allclose(shape.points * shape.scale + np.array(shape.center), parts.points, atol=1e-5), (
        "candidates are the labelled points"
    )
    assert shape.vertex_colors is None


def test_all_fifty_labels_are_some_class_s() -> None:
    assert [label for labels in LABELS.values() for label in labels] == list(range(50))
    assert len(LABELS) == 16


def test_classes_can_be_chosen_and_splits_are_optional(tmp_path: Path) -> None:
    root = make_shapenetpart(tmp_path)
    for path in (root / "train_test_split").iterdir():
        path.unlink()
    shapes = ShapeNetPart(root=root, classes=["Mug"]).shapes()
    assert [(s.name, s.official) for s in shapes] == [("Mug/m0", None), ("Mug/m1", None), ("Mug/m2", None)]


def test_a_listed_file_that_is_missing_is_that_shape_s_error(tmp_path: Path) -> None:
    root = make_shapenetpart(tmp_path)
    (root / SYNSETS["Mug"] / "m1.txt").unlink()
    shapes = by_name(ShapeNetPart(root=root).shapes())
    assert "Mug/m1: expected 03797390/m1.txt" in (shapes["Mug/m1"].error or "")
    assert shapes["Mug/m0"].error is None


def test_the_content_is_the_address_not_the_place(tmp_path: Path) -> None:
    one, other = (ShapeNetPart(root=make_shapenetpart(tmp_path / name)).shapes()[0] for name in ("a", "b"))
    for name in ("source", "parts"):
        assert one.leaves[name].values == other.leaves[name].values
        assert one.leaves[name].files.keys() == other.leaves[name].files.keys()
    assert one.leaves["source"].values != one.leaves["parts"].values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 0 0 0 1\n", "rows `x y z nx ny nz label`, got rows of \\[6\\] numbers"),
        ("\n", "got rows of no numbers"),
        ("0 0 0 0 0 1 12\n", "expected labels 36 … 37, got 12"),
        ("0 0 0 0 0 1 36.5\n", "expected labels 36 … 37, got 36.5"),
        ("0 0 0 0 0 1 mug\n", "expected numbers, got 'mug'"),
    ],
)
def test_bad_rows_name_the_shape(tmp_path: Path, text: str, message: str) -> None:
    root = make_shapenetpart(tmp_path)
    (root / SYNSETS["Mug"] / "m0.txt").write_text(text)
    with pytest.raises(ValueError, match=f"Mug/m0: .*{message}"):
        read(by_name(ShapeNetPart(root=root).shapes())["Mug/m0"].leaves["parts"])


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"expected .*synsetoffset2category.txt, got none"):
        ShapeNetPart(root=tmp_path).shapes()
    root = make_shapenetpart(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"expected classes among Laptop, Mug in .*, got Airplane"):
        ShapeNetPart(root=root, classes=["Mug", "Airplane"]).shapes()
    put(root, {"synsetoffset2category.txt": "Teapot\t03642806\n"})
    with pytest.raises(ValueError, match=r"expected classes among Airplane, .* got Teapot"):
        ShapeNetPart(root=root, classes=["Teapot"]).shapes()
    (teapots,) = ShapeNetPart(root=root).shapes()
    assert teapots.category == "Teapot" and "got Teapot" in str(teapots.error)
