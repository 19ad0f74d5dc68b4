"""Readers: vertices in the file's order, polygons as fans."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Cloud, Surface
from tests.shared_data import shared

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 1.5, 0]]


def surface(data: bytes, name: str, **files: bytes) -> Surface:
    loaded = load("class/shape", {name: data, **files}, name)
    assert isinstance(loaded, Surface)
    return loaded


def cloud(data: bytes, name: str) -> Cloud:
    loaded = load("class/shape", {name: data}, name)
    assert isinstance(loaded, Cloud)
    return loaded


def fan(polygons: list[list[int]]) -> list[list[int]]:
    return [[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)]


# --- meshes: order, polygons, dialects -------------------------------------------------------------------------------


@st.composite
def polygon_meshes(draw: st.DrawFn) -> tuple[np.ndarray, list[list[int]]]:
    """Convex polygons: their corners lie on a parabola in a slanted plane, in its order."""
    x = np.array(sorted(draw(st.sets(st.integers(-60, 60), min_size=3, max_size=12))), np.float64)
    vertices = np.stack([x, x * x, 3 * x - 2], axis=1) / 8
    corners = st.sets(st.integers(0, len(x) - 1), min_size=3, max_size=6).map(sorted)
    return vertices, draw(st.lists(corners, min_size=1, max_size=8))


def obj(vertices: np.ndarray, polygons: list[list[int]], style: str, relative: bool, end: str) -> bytes:
    """An OBJ whose corners are all written in one style (`v`, `v/t`, `v//n`, `v/t/n`) or in all of them in turn."""
    lines = ["# made by a test", "mtllib none.mtl"]
    lines += [f"v {x:.17g} {y:.17g}\t{z:.17g}" for x, y, z in vertices]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vn 0 0 1", "usemtl a"]
    for i, polygon in enumerate(polygons):
        words = []
        for j, v in enumerate(polygon):
            index = v - len(vertices) if relative else v + 1
            t = -1 - (i + j) % 3 if relative else 1 + (i + j) % 3
            kind = style if style != "mixed" else ("v", "v/t", "v//n", "v/t/n")[(i + j) % 4]
            words.append(
                {"v": f"{index}", "v/t": f"{index}/{t}", "v//n": f"{index}//1", "v/t/n": f"{index}/{t}/1"}[kind]
            )
        lines += [
            f"usemtl m{i % 2}",
            "  f " + (" \\\n " if i == 0 else " ").join(words) + ("  # remark" if i == 1 else " "),
        ]
    return end.join(lines).replace("\\\n", "\\" + end).encode()


@settings(max_examples=60, deadline=None)
@given(
    polygon_meshes(),
    st.sampled_from(["v", "v/t", "v//n", "v/t/n", "mixed"]),
    st.booleans(),
    st.sampled_from(["\n", "\r\n"]),
)
def test_obj_keeps_its_v_lines_in_every_dialect(
    mesh: tuple[np.ndarray, list[list[int]]], style: str, relative: bool, end: str
) -> None:
    vertices, polygons = mesh
    read = surface(obj(vertices, polygons, style, relative, end), "mesh.obj")
    np.testing.assert_array_equal(read.vertices, vertices)
    np.testing.assert_array_equal(read.faces, fan(polygons))


def ply(vertices: np.ndarray, polygons: list[list[int]], encoding: str, double: bool = False) -> bytes:
    """A PLY with a leading element to pass over, a property behind the coordinates, and one before and one behind the
    list."""
    order = ">" if "big" in encoding else "<"
    real, name = ("f8", "double") if double else ("f4", "float")
    header = f"ply\nformat {encoding} 1.0\ncomment made by a test\nelement camera 1\nproperty int mode\n"
    header += (
        f"element vertex {len(vertices)}\n"
        + "".join(f"property {name} {axis}\n" for axis in "xyz")
        + "property uchar quality\n"
    )
    header += f"element face {len(polygons)}\nproperty uchar flags\nproperty list uchar int vertex_indices\n"
    header += "property short group\nend_header\n"
    if encoding == "ascii":
        rows = ["7", *(f"{x:.9g} {y:.9g} {z:.9g} 3" for x, y, z in vertices)]
        rows += [f"1 {len(p)} {' '.join(map(str, p))} -2" for p in polygons]
        return (header + "\n".join(rows) + "\n").encode()
    body = np.array([7], order + "i4").tobytes()
    for v in vertices:
        body += v.astype(order + real).tobytes() + b"\x03"
    for p in polygons:
        body += b"\x01" + bytes([len(p)]) + np.array(p, order + "i4").tobytes() + np.array([-2], order + "i2").tobytes()
    return header.encode() + body


@settings(max_examples=60, deadline=None)
@given(polygon_meshes(), st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]), st.booleans())
def test_ply_of_mixed_polygons(mesh: tuple[np.ndarray, list[list[int]]], encoding: str, double: bool) -> None:
    vertices, polygons = mesh
    read = surface(ply(vertices, polygons, encoding, double), "mesh.ply")
    np.testing.assert_array_equal(read.vertices, vertices)
    np.testing.assert_array_equal(read.faces, fan(polygons))


@settings(max_examples=40, deadline=None)
@given(polygon_meshes(), st.sampled_from(["OFF\n", "OFF ", "OFF", "# remark\nOFF\n\n", "COFF\n"]))
def test_off_of_mixed_polygons(mesh: tuple[np.ndarray, list[list[int]]], head: str) -> None:
    vertices, polygons = mesh
    color = " 255 0 9 255" if head.startswith("C") else ""
    lines = [f"{head}{len(vertices)} {len(polygons)} 0"] + [
        f"{x:.17g} {y:.17g} {z:.17g}{color}" for x, y, z in vertices
    ]
    lines += [f"{len(p)} {' '.join(map(str, p))} 0.5 0.5 0.5" for p in polygons]
    read = surface("\n".join(lines).encode(), "mesh.off")
    np.testing.assert_array_equal(read.vertices, vertices)
    np.testing.assert_array_equal(read.faces, fan(polygons))
    if color:
        assert read.vertex_colors is not None
        assert (read.vertex_colors == [255, 0, 9]).all()


@pytest.mark.parametrize("suffix", ["ply", "obj", "off", "stl", "glb"])
def test_what_trimesh_writes(suffix: str) -> None:
    """The same triangles in the same places, whatever the format."""
    mesh = trimesh.creation.torus(1.0, 0.3, major_sections=12, minor_sections=7)
    read = surface(
        mesh.export(file_type=suffix) if suffix not in ("obj", "off") else mesh.export(file_type=suffix).encode(),
        f"m.{suffix}",
    )
    np.testing.assert_allclose(read.vertices[read.faces], mesh.triangles, atol=1e-6)
    if suffix != "stl":  # STL has no shared vertices
        np.testing.assert_allclose(read.vertices, mesh.vertices, atol=1e-6)


def test_glb_scene_applies_transforms_and_keeps_outside_out() -> None:
    box = trimesh.creation.box()
    mirror = np.diag([-1.0, 1, 1, 1])
    mirror[0, 3] = 5
    scene = trimesh.Scene()
    scene.add_geometry(box, node_name="a")
    scene.add_geometry(box, node_name="b", transform=mirror)
    read = surface(scene.export(file_type="glb"), "scene.glb")
    assert read.vertices.shape == (16, 3)
    both = trimesh.Trimesh(read.vertices, read.faces, process=False)
    np.testing.assert_allclose(both.bounds, [[-0.5, -0.5, -0.5], [5.5, 0.5, 0.5]])
    assert both.volume == pytest.approx(2)  # an inside-out box would count negative


def test_gltf_with_files_beside_it() -> None:
    files = {name: bytes(data) for name, data in trimesh.creation.box().export(file_type="gltf").items()}
    read = load("s", files, "model.gltf")
    assert isinstance(read, Surface)
    assert read.faces.shape == (12, 3)


def test_obj_beside_trimesh_on_real_textured_meshes() -> None:
    """trimesh renumbers, but must see the same triangles in space."""
    for name in ("bedsideTable2", "deckChair", "couch2"):
        path = shared(f"textured/sweethome3d/{name}/{name}.obj")
        read = surface(path.read_bytes(), "mesh.obj")
        written = [line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")]
        np.testing.assert_array_equal(read.vertices, np.array(written, np.float64))
        theirs = trimesh.load_scene(path, process=False, skip_materials=True).to_mesh()
        ours = np.sort(read.vertices[read.faces].mean(axis=1).round(6), axis=0)
        np.testing.assert_allclose(ours, np.sort(theirs.triangles.mean(axis=1).round(6), axis=0), atol=2e-6)


# --- clouds ----------------------------------------------------------------------------------------------------------

POINTS = np.array([[0.5, -1.25, 2], [3, 4, 5], [-0.125, 0, 1e-3], [7, 8, 9]])
COLORS = np.array([[255, 0, 1], [2, 3, 4], [0, 0, 0], [255, 255, 255]], np.uint8)
PACKED = COLORS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)


def pcd(encoding: str, kind: str) -> bytes:
    head = f"# .PCD v.7\nVERSION .7\nFIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U {kind}\nCOUNT 1 1 1 2 1\n"
    head += f"WIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {encoding}\n"
    if encoding == "binary":
        rows = np.zeros(4, [("p", "<f4", 3), ("pad", "u1", 2), ("rgb", "<u4")])
        rows["p"], rows["rgb"] = POINTS, PACKED
        return head.encode() + rows.tobytes()
    rgb = PACKED.view(np.float32) if kind == "F" else PACKED
    return (head + "".join(f"{x} {y} {z} 0 0 {c!s}\n" for (x, y, z), c in zip(POINTS, rgb, strict=True))).encode()


def npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (pcd("ascii", "U"), "c.pcd"),
        (pcd("ascii", "F"), "c.pcd"),
        (pcd("binary", "U"), "c.pcd"),
        (pcd("binary", "F"), "c.pcd"),
        (npz(points=POINTS, colors=COLORS), "c.npz"),
        (npz(anything=np.hstack([POINTS, POINTS]), rgb=COLORS / 255), "c.npz"),
        ("\n".join(" ".join(map(str, [*p, *c])) for p, c in zip(POINTS, COLORS, strict=True)).encode(), "c.xyz"),
        (
            b"x,y,z,r,g,b\n"
            + b"\r\n".join(",".join(map(str, [*p, *c])).encode() for p, c in zip(POINTS, COLORS, strict=True)),
            "c.xyz",
        ),
        (trimesh.PointCloud(POINTS, COLORS).export(file_type="ply"), "c.ply"),
        (trimesh.PointCloud(POINTS, COLORS).export(file_type="glb"), "c.glb"),
        (
            "\n".join(
                "v " + " ".join(map(str, [*p, *(c / 255)])) for p, c in zip(POINTS, COLORS, strict=True)
            ).encode(),
            "c.obj",
        ),
    ],
)
def test_clouds_keep_order_and_colors(data: bytes, name: str) -> None:
    read = cloud(data, name)
    np.testing.assert_allclose(read.points, POINTS, rtol=1e-6)
    assert read.colors is not None
    if not (
        name == "c.pcd" and b"TYPE F F F U F" in data and b"ascii" in data
    ):  # a float's text may lose the packed bits
        np.testing.assert_array_equal(read.colors, COLORS)


def test_xyz_with_normals_has_no_colors() -> None:
    assert cloud(b"4\n0 0 0 0 0 1\n1 0 0 0 1 0\n0 1 0 1 0 0\n0 0 1 0 0.6 0.8\n", "c.xyz").colors is None
    assert len(cloud(b"4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", "c.xyz").points) == 4


def test_nan_and_infinity_are_numbers() -> None:
    read = surface(b"v nan 0 0\nv 1 -inf 0\nv 0 1 -1.#IND\nv 0 0 0\nf 1 2 3\n", "m.obj")
    assert np.isfinite(read.vertices).tolist() == [
        [False, True, True],
        [True, False, True],
        [True, True, False],
        [True] * 3,
    ]
