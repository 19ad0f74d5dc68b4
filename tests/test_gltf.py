"""glTF: every legal spelling of a mesh reads as that mesh; what is not known is refused by name."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Surface
from tests.made_gltf import QUAD, TABLE, Gltf
from tests.reading import area, box, cloud, surface


def one(document: Gltf, **node: Any) -> Surface:
    document.add("nodes", {"mesh": 0, **node})
    return surface(document.glb(), "m.glb")


def by_the_standard(index: list[int], mode: int) -> list[list[int]]:
    """Sections 3.7.2.1 of the standard, triangle by triangle."""
    if mode == 4:
        return [index[i : i + 3] for i in range(0, len(index) - 2, 3)]
    if mode == 5:
        return [[index[i], index[i + 1 + i % 2], index[i + 2 - i % 2]] for i in range(len(index) - 2)]
    return [[index[0], index[i + 1], index[i + 2]] for i in range(len(index) - 2)]


@st.composite
def spelled(draw: st.DrawFn) -> tuple[Gltf, np.ndarray, list[list[int]]]:
    """A document of one mesh in some spelling; its vertices in the world and its triangles."""
    count = draw(st.integers(3, 9))
    rows = st.lists(st.tuples(*[st.integers(-99, 99)] * 3), min_size=count, max_size=count)
    points = np.array(draw(rows), np.float32)
    sparse, stride = draw(st.sampled_from(["", "base", "zeros"])), draw(st.sampled_from([0, 12, 20]))
    mode = draw(st.sampled_from([4, 5, 6]))
    index = draw(st.lists(st.integers(0, count - 1), min_size=3, max_size=12))
    index = index[: len(index) // 3 * 3] if mode == 4 else index
    document = Gltf()
    primitive: dict[str, Any] = {"attributes": {"POSITION": document.accessor(points, stride=stride, sparse=sparse)}}
    if mode != 4 or draw(st.booleans()):
        primitive["mode"] = mode
    kind = draw(st.sampled_from(["u1", "u2", "u4", "none"]))
    if kind == "none":
        index = list(range(count if mode != 4 else count // 3 * 3))
    else:
        spelling = draw(st.sampled_from(["", "base", "zeros"]))
        primitive["indices"] = document.accessor(np.array(index, kind), sparse=spelling)
    document.add("meshes", {"primitives": [primitive]})
    moved, child = points.astype(np.float64), {"mesh": 0}
    if draw(st.booleans()):
        child |= {"translation": [1, 2, 3], "scale": [2, 4, 8], "rotation": [0, 0, 0.5**0.5, 0.5**0.5]}
        moved = moved * [2, 4, 8] @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]) + [1, 2, 3]
    parent: dict[str, Any] = {"children": [1]}
    if draw(st.booleans()):
        parent["matrix"] = [0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 6, 7, 1]  # x → z, y → x, z → y
        moved = moved[:, [1, 2, 0]] + [5, 6, 7]
    document.tree["nodes"] = [parent, child]
    document.tree |= draw(st.sampled_from([{}, {"scenes": []}, {"scenes": [{"nodes": [0]}]}]))
    return document, moved, by_the_standard(index, mode)


@settings(max_examples=150, deadline=None)
@given(spelled(), st.sampled_from(["glb", "file", "within"]))
def test_every_spelling_reads_as_the_same_mesh(spelt: tuple[Gltf, np.ndarray, list[list[int]]], where: str) -> None:
    document, points, triangles = spelt
    name, files = ("m.glb", {}) if where == "glb" else ("m.gltf", {"a b.bin": bytes(document.data)})
    data = document.glb() if where == "glb" else document.gltf("a%20b.bin" if where == "file" else None)
    read = surface(data, name, files)
    np.testing.assert_allclose(read.vertices, points, atol=1e-9)
    np.testing.assert_array_equal(read.faces, triangles)


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2"])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantized_positions(kind: str, normalized: bool) -> None:
    most = np.iinfo(kind).max
    document = Gltf()
    position = document.accessor((TABLE * most).astype(kind), stride=8, normalized=normalized)
    document.add("meshes", {"primitives": [{"attributes": {"POSITION": position}, "indices": document.accessor(QUAD)}]})
    document.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    assert box(one(document, scale=[2, 3, 1])) == ([2, 3, 0] if normalized else [2 * most, 3 * most, 0])


def test_a_sparse_place_beyond_its_accessor_is_refused() -> None:
    document = Gltf()
    document.mesh()
    entry = document.tree["accessors"][document.accessor(TABLE, sparse="base")]
    document.tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 2
    entry["count"] = 3
    with pytest.raises(ValueError, match=r"class/shape: m.glb: sparse accessor 2: expected places below 3, got 3"):
        one(document)


def test_scenes() -> None:
    """The default one; the first where none is; all roots where there are none."""
    document = Gltf()
    document.mesh()
    document.tree["nodes"] = [{"mesh": 0, "translation": [10 * i, 0, 0]} for i in range(3)]
    assert box(surface(document.glb(), "m.glb")) == [21, 1, 0]
    document.tree["scenes"] = [{"nodes": [0, 1]}, {"nodes": [2]}]
    assert box(surface(document.glb(), "m.glb")) == [11, 1, 0]
    document.tree["scene"] = 1
    assert surface(document.glb(), "m.glb").vertices[:, 0].min() == 20


def test_hidden_nodes_and_what_is_below_them_are_not_drawn() -> None:
    document = Gltf()
    document.mesh()
    document.tree["nodes"] = [{"mesh": 0, "translation": [10 * i, 0, 0]} for i in range(4)]
    document.tree["scenes"] = [{"nodes": [0, 1, 3]}]
    document.tree["nodes"][1] |= {"children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}}
    document.tree["nodes"][3]["extensions"] = {"KHR_node_visibility": {"visible": True}}
    document.tree["extensionsRequired"] = ["KHR_node_visibility"]
    assert sorted({*surface(document.glb(), "m.glb").vertices[:, 0]}) == [0, 1, 30, 31]


def test_instances_share_a_mesh_and_mirrors_keep_outside_out() -> None:
    document = Gltf()
    document.mesh()
    moves = document.accessor(np.array([[0, 0, 0], [5, 0, 0]], np.float32))
    turns = document.accessor(np.array([[0, 0, 0, 127], [0, 0, 127, 0]], np.int8), normalized=True)
    scales = document.accessor(np.array([[1, 1, 1], [2, 1, 1]], np.float32))
    given_ = {"TRANSLATION": moves, "ROTATION": turns, "SCALE": scales}
    instancing = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": given_}}, "scale": [-1, 1, 1]}
    document.tree["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    read = one(document, **instancing)
    assert box(read) == [5, 2, 0]
    assert area(read) == pytest.approx(3)
    corners = read.vertices[read.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all(), "still up"


def test_morphs_at_rest_and_skins_as_bound() -> None:
    document = Gltf()
    document.mesh()
    lift = document.accessor(np.tile(np.array([0, 0, 2], np.float32), (4, 1)))
    document.tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": lift}, {"POSITION": lift}]
    document.tree["meshes"][0]["weights"] = [0.25, 0]
    assert one(document).vertices[:, 2].tolist() == [0.5] * 4
    document.tree["nodes"] = []
    assert one(document, weights=[1, 1]).vertices[:, 2].tolist() == [4] * 4

    skinned = Gltf()
    joints = skinned.accessor(np.tile(np.array([0, 1, 0, 0], np.uint8), (4, 1)))
    weights = skinned.accessor(np.tile(np.array([0.5, 0.5, 0, 0], np.float32), (4, 1)))
    skinned.mesh(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights})
    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse[1, :3, 3] = [0, 0, 8]
    bound = skinned.accessor(inverse.transpose(0, 2, 1).reshape(2, 16))
    skinned.add("skins", {"joints": [1, 2], "inverseBindMatrices": bound})
    skinned.tree["nodes"] = [{"mesh": 0, "skin": 0, "translation": [99, 0, 0]}, {"translation": [2, 0, 0]}, {}]
    read = surface(skinned.glb(), "m.glb")
    np.testing.assert_allclose(read.vertices, TABLE + np.array([1, 0, 4]))


def test_points_and_lines_beside_faces_are_counted() -> None:
    document = Gltf()
    document.mesh()
    more = {"POSITION": document.accessor(TABLE)}
    document.tree["meshes"][0]["primitives"] += [{"attributes": more, "mode": 1}, {"attributes": more, "mode": 0}]
    read = one(document)
    assert read.problems == {"skipped_lines": 1, "skipped_points": 4}
    assert len(read.vertices) == 4
    document.tree["meshes"][0]["primitives"] = [{"attributes": more, "mode": 0}]
    assert len(cloud(document.glb(), "m.glb").points) == 4


def test_compressed_meshes_or_the_extra_named(monkeypatch: pytest.MonkeyPatch) -> None:
    draco, meshopt = pytest.importorskip("DracoPy"), pytest.importorskip("meshoptimizer")
    document = Gltf()
    document.mesh(index=np.array([0, 1, 2, 0, 2, 3], np.uint32))
    primitive = document.tree["meshes"][0]["primitives"][0]
    packed = draco.encode(TABLE, QUAD.reshape(-1, 3).astype(np.uint32), quantization_bits=16)
    for accessor in document.tree["accessors"]:
        del accessor["bufferView"]
    extension = {"bufferView": document.view(packed), "attributes": {"POSITION": 0}}
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    document.tree["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    assert area(one(document)) == pytest.approx(1, abs=1e-3)

    packed_views = Gltf()
    packed_views.mesh()
    streams = [
        ("ATTRIBUTES", meshopt.encode_vertex_buffer(TABLE, 4, 12), 4, 12),
        ("TRIANGLES", meshopt.encode_index_buffer(QUAD.astype(np.uint32), 6, 4), 6, 2),
    ]
    for view, (mode, stream, count, stride) in zip(packed_views.tree["bufferViews"][:2], streams, strict=True):
        stored = packed_views.tree["bufferViews"][packed_views.view(bytes(stream))]
        how = {"mode": mode, "count": count, "byteStride": stride}
        view["extensions"] = {"EXT_meshopt_compression": {**stored, **how}}
    packed_views.tree["bufferViews"] = packed_views.tree["bufferViews"][:2]
    assert area(one(packed_views)) == pytest.approx(1)

    def absent(package: str) -> None:
        raise ModuleNotFoundError(package)

    monkeypatch.setattr(importlib, "import_module", absent)
    for data in (document.glb(), packed_views.glb()):
        with pytest.raises(ValueError, match=r"class/shape: m.glb: .* pip install 'b23d\[gltf\]'"):
            surface(data, "m.glb")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extensionsRequired": ["ACME_cubes"]}, "extensionsRequired: .* got ACME_cubes"),
        ({"asset": {"version": "1.0"}}, "asset: expected version 2.0"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "circle"),
        ({"nodes": [{"children": [1]}, {"children": [1]}], "scenes": [{"nodes": [0]}]}, "second"),
        ({"nodes": [{"mesh": 7}]}, "meshes: expected an entry 7, got 1"),
        ({"nodes": [{"children": [9]}]}, "nodes: expected an entry 9"),
        ({"nodes": [{"mesh": 0, "matrix": [float("nan")] * 16}]}, "finite matrix"),
        ({"buffers": [{"byteLength": 9, "uri": "gone.bin"}]}, "buffer 0: expected gone.bin among the shape's files"),
        ({"meshes": [{}]}, "JSON: expected an object with primitives, got one with nothing"),
        ({"meshes": [{"primitives": [{"mode": 4}]}]}, "JSON: expected an object with attributes, got one with mode"),
        ({"bufferViews": [{"byteLength": 1}] * 2}, "JSON: expected an object with buffer, got one with byteLength"),
        ({"accessors": [{"count": 1, "type": "VEC3"}] * 2}, "expected an object with componentType"),
        ({"accessors": [{"count": 1, "type": "VEC9", "componentType": 5126}] * 2}, "expected a type of .* got VEC9"),
        ({"accessors": [{"count": 1, "type": "VEC3", "componentType": 5124}] * 2}, "componentType of .* got 5124"),
        ({"buffers": [{"byteLength": 1 << 40, "uri": "data:,abc"}]}, "buffer 0: expected 1099511627776 bytes, got 3"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(change: dict[str, Any], words: str) -> None:
    document = Gltf()
    document.mesh()
    document.add("nodes", {"mesh": 0})
    document.gltf()
    document.tree |= change
    import json

    with pytest.raises(ValueError, match=f"class/shape: m.gltf: .*{words}"):
        load("class/shape", {"m.gltf": json.dumps(document.tree).encode()}, "m.gltf")


def test_numbers_that_no_file_of_this_size_explains_are_refused_before_they_are_made() -> None:
    document = Gltf()
    document.mesh()
    document.tree["accessors"][0] = {"componentType": 5126, "count": 1 << 40, "type": "VEC3"}
    with pytest.raises(ValueError, match="many times as many"):
        one(document)
