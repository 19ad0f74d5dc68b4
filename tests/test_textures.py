"""Colours: materials, images and palettes end in one texture that shows at every place what the file has there."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.normalize import NormalizeParams, normalize

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 1.5, 0]]
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
SHADES = np.stack(np.broadcast_arrays(np.arange(64)[None, :] * 4, np.arange(48)[:, None] * 5, 90), axis=2).astype(
    np.uint8
)
"""Red grows to the right, green downwards."""


def png(image: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "png")
    return buffer.getvalue()


def seen(shape: NormalizedShape, face: int, barycentrics: tuple[float, float, float]) -> np.ndarray:
    """The texture's colour at a place on a face, as a renderer looks it up."""
    assert shape.face_uvs is not None
    assert shape.texture is not None
    height, width = shape.texture.shape[:2]
    u, v = np.array(barycentrics) @ shape.face_uvs[face]
    return shape.texture[min(int((1 - v) * height), height - 1), min(int(u * width), width - 1)].astype(int)


def expected(u: float, v: float) -> np.ndarray:
    """SHADES at (u, v) in repeats, origin at the lower left."""
    return SHADES[int((1 - v % 1) * 48) % 48, int((u % 1) * 64)].astype(int)


MTL = (
    b"newmtl pic\nKd 0 0 0\nmap_Kd -s 1 1 1 my pic.png\n"
    b"newmtl plain\nKd 1 .5 0\nnewmtl lost\nKd 0 0 1\nmap_Kd C:\\gone.jpg\n"
)
PLACES = [(0.8, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.8), (0.3, 0.3, 0.4)]


def textured(uvs: list[tuple[float, float]], more: bytes = b"") -> NormalizedShape:
    lines = [b"mtllib sub/a.mtl", *(b"v %g %g %g" % tuple(v) for v in SQUARE), *(b"vt %.9g %.9g" % uv for uv in uvs)]
    lines += [b"usemtl pic", b"f 1/1 2/2 3/3", more]
    files = {"mesh.obj": b"\n".join(lines), "sub/a.mtl": MTL, "sub/my pic.png": png(SHADES)}
    return normalize(Source(shape="s", files=files, mesh="mesh.obj"), NormalizeParams(count=64))


@pytest.mark.parametrize(
    "uvs",
    [
        [(0, 0), (1, 0), (1, 1)],
        [(0.2, 0.1), (0.9, 0.3), (0.6, 0.7)],
        [(-3.8, 7.1), (-3.1, 7.3), (-3.4, 7.7)],
        [(0.5, 0.5), (2.5, 0.6), (1.5, 3.4)],
    ],
)
@pytest.mark.parametrize("more", [b"", b"usemtl plain\nf 3 4 5\nusemtl unknown\nf 1 3 4"])
def test_texture_shows_what_the_image_has_there(uvs: list[tuple[float, float]], more: bytes) -> None:
    """Alone or in an atlas; within one repeat, shifted by whole repeats, or across several."""
    shape = textured(uvs, more)
    assert shape.face_uvs is not None
    assert shape.face_uvs.min() >= 0
    assert shape.face_uvs.max() <= 1
    for place in PLACES:
        u, v = np.array(place) @ np.array(uvs)
        assert np.abs(seen(shape, 0, place) - expected(u, v)).max() <= 5, "one texel at most"
    if more:
        assert seen(shape, 1, PLACES[0]).tolist() == [255, 128, 0]
        assert seen(shape, 2, PLACES[0]).tolist() == [178, 178, 178]


def test_too_many_repeats_show_the_mean() -> None:
    shape = textured([(0, 0), (300, 0), (0, 300)])
    assert np.abs(seen(shape, 0, PLACES[0]) - SHADES.reshape(-1, 3).mean(axis=0)).max() <= 1


def test_missing_texture_leaves_the_color_and_is_counted() -> None:
    shape = textured([(0, 0), (1, 0), (1, 1)], b"usemtl lost\nf 1/1 3/2 4/3")
    assert shape.repairs["missing_textures"] == 1
    assert seen(shape, 1, PLACES[0]).tolist() == [0, 0, 255]


def test_colors_off_reads_none() -> None:
    files = {"m.obj": b"mtllib a.mtl\n" + TRIANGLE + b"vt 0 0\nusemtl plain\nf 1/1 2/1 3/1\n", "a.mtl": MTL}
    shape = normalize(Source(shape="s", files=files, mesh="m.obj"), NormalizeParams(count=8, colors=False))
    assert shape.texture is None
    assert shape.face_uvs is None
    assert "missing_textures" not in shape.repairs


def test_glb_texture_and_plain_material() -> None:
    """glTF keeps the origin at the upper left, trimesh turns it; the base colour factor is linear light."""
    pictured = trimesh.Trimesh(SQUARE[:3], [[0, 1, 2]], process=False)
    pictured.visual = trimesh.visual.TextureVisuals(
        [(0.1, 0.2), (0.9, 0.2), (0.9, 0.7)],
        trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(SHADES)),
    )
    plain = trimesh.Trimesh(np.array(SQUARE[2:]) + 1, [[0, 1, 2]], process=False)
    plain.visual = trimesh.visual.TextureVisuals(
        None, trimesh.visual.material.PBRMaterial(baseColorFactor=[55, 0, 255, 255])
    )
    data = trimesh.Scene([pictured, plain]).export(file_type="glb")
    shape = normalize(Source(shape="s", files={"m.glb": data}, mesh="m.glb"), NormalizeParams(count=8))
    for place in PLACES:
        u, v = np.array(place) @ np.array([(0.1, 0.2), (0.9, 0.2), (0.9, 0.7)])
        assert np.abs(seen(shape, 0, place) - expected(u, v)).max() <= 5
    red, green, blue = seen(shape, 1, PLACES[0])
    assert (red, green, blue) == (pytest.approx(128, abs=1), 0, 255)


def test_vertex_colors_follow_the_vertices() -> None:
    mesh = trimesh.creation.box()
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.arange(24).reshape(8, 3).astype(np.uint8))
    for suffix in ("ply", "glb"):
        data = mesh.export(file_type=suffix)
        shape = normalize(
            Source(shape="s", files={"m": data, f"m.{suffix}": data}, mesh=f"m.{suffix}"), NormalizeParams(count=8)
        )
        np.testing.assert_array_equal(shape.vertex_colors, np.arange(24).reshape(8, 3))


def test_ply_face_colors_become_a_palette() -> None:
    mesh = trimesh.creation.box()
    colors = np.arange(36).reshape(12, 3).astype(np.uint8) * 7
    mesh.visual = trimesh.visual.ColorVisuals(mesh, face_colors=colors)
    shape = normalize(
        Source(shape="s", files={"m.ply": mesh.export(file_type="ply")}, mesh="m.ply"), NormalizeParams(count=8)
    )
    for face in range(12):
        assert seen(shape, face, PLACES[face % 4]).tolist() == colors[face].tolist()


def test_ply_corner_texture_keeps_vertices_shared() -> None:
    """MeshLab's per-corner coordinates: trimesh would split the vertices."""
    head = b"ply\nformat ascii 1.0\ncomment TextureFile pic.png\nelement vertex 4\n"
    head += b"property float x\nproperty float y\nproperty float z\n"
    head += b"element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n"
    body = b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 .1 .1 .9 .1 .9 .6\n3 0 2 3 6 .8 .9 .2 .3 .4 .9\n"
    files = {"m.ply": head + body, "pic.png": png(SHADES)}
    shape = normalize(Source(shape="s", files=files, mesh="m.ply"), NormalizeParams(count=8))
    assert len(shape.vertices) == 4
    for face, uvs in enumerate([[(0.1, 0.1), (0.9, 0.1), (0.9, 0.6)], [(0.8, 0.9), (0.2, 0.3), (0.4, 0.9)]]):
        u, v = np.array(PLACES[3]) @ np.array(uvs)
        assert np.abs(seen(shape, face, PLACES[3]) - expected(u, v)).max() <= 5
