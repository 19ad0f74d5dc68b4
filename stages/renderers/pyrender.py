"""OpenGL through pyrender and EGL: a GPU, or Mesa's software rasterizer. One flat, colour-coded pass a view.

Every face is drawn unlit in a colour that is its index, so that one pass gives exact face ids and depth; shading,
texture included, is `shading.py`'s, as for every renderer. Versions this works around: pyrender 0.1.45.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")  # read when OpenGL is first imported, by pyrender below
if not hasattr(np, "infty"):
    # pyrender 0.1.45's Mesh.bounds says np.infty, which numpy 2 removed
    np.infty = np.inf  # type: ignore[attr-defined]

import pyrender
from OpenGL import GL
from pyrender.renderer import Renderer

from b23d.stages.renderers import NEEDS, Raster

MOST_FACES = 2**24 - 1
"""Face ids travel as 24-bit colours; 0 is background."""


class _SingleSample(Renderer):
    """pyrender's renderer without multisampling, which would blend the ids of neighbouring faces and shift depths."""

    def _configure_main_framebuffer(self) -> None:
        fresh = self._main_fb is None
        super()._configure_main_framebuffer()
        if fresh:
            for buffer, kind in ((self._main_cb_ms, GL.GL_RGBA), (self._main_db_ms, GL.GL_DEPTH_COMPONENT24)):
                GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
                GL.glRenderbufferStorageMultisample(
                    GL.GL_RENDERBUFFER, 0, kind, self.viewport_width, self.viewport_height
                )
            GL.glDisable(GL.GL_DITHER)


class _Offscreen(pyrender.OffscreenRenderer):
    def _create(self) -> None:
        super()._create()
        self._renderer = _SingleSample(self.viewport_width, self.viewport_height)


def rasterize(
    vertices: np.ndarray, faces: np.ndarray, world_to_camera: np.ndarray, intrinsics: np.ndarray, resolution: int
) -> Raster:
    """See `stages.renderers.Rasterize`. Deterministic on one machine; drivers differ at faces' edges.

    Raises RuntimeError where EGL gives no context, ValueError above `MOST_FACES` faces.
    """
    shape = (len(world_to_camera), resolution, resolution)
    face_ids, depth = np.full(shape, -1, np.int32), np.zeros(shape, np.float32)
    if len(faces) == 0:
        return Raster(face_ids, depth)
    if len(faces) > MOST_FACES:
        raise ValueError(
            f'faces: expected at most {MOST_FACES} for pyrender, got {len(faces)}; use renderer = "embree"'
        )
    near, far = _depth_range(vertices[np.unique(faces)], world_to_camera)
    scene = pyrender.Scene(bg_color=[0.0, 0.0, 0.0, 0.0])
    scene.add(pyrender.Mesh([_coded(vertices, faces)]))
    camera = pyrender.IntrinsicsCamera(
        intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2], znear=near, zfar=far
    )
    node = scene.add(camera)
    flags = pyrender.RenderFlags.FLAT | pyrender.RenderFlags.SKIP_CULL_FACES
    offscreen = _open(resolution)
    try:
        for view, transform in enumerate(world_to_camera):
            # OpenGL's camera looks along -z with y up
            scene.set_pose(node, np.linalg.inv(transform) @ np.diag([1.0, -1.0, -1.0, 1.0]))
            colors, depth[view] = offscreen.render(scene, flags)
            face_ids[view] = colors.astype(np.int32) @ np.array([1, 256, 65536], np.int32) - 1
    finally:
        offscreen.delete()
    return Raster(face_ids, np.where(face_ids < 0, np.float32(0), depth))


def _coded(vertices: np.ndarray, faces: np.ndarray) -> pyrender.Primitive:
    """The triangles, none sharing a vertex, each of one colour: its index + 1, lowest byte red."""
    code = np.arange(1, len(faces) + 1)
    colors = np.stack([code & 255, code >> 8 & 255, code >> 16, np.full_like(code, 255)], axis=1) / 255
    return pyrender.Primitive(
        positions=np.asarray(vertices, np.float32)[faces].reshape(-1, 3),
        color_0=np.repeat(colors.astype(np.float32), 3, axis=0),
        mode=pyrender.GLTF.TRIANGLES,
        material=pyrender.MetallicRoughnessMaterial(doubleSided=True, alphaMode="OPAQUE"),
    )


def _depth_range(points: np.ndarray, world_to_camera: np.ndarray) -> tuple[float, float]:
    """A near and a far plane close around all points in all views: depth's 24 bits are spent there."""
    near, far = np.inf, 0.0
    for transform in world_to_camera:
        depths = points @ transform[2, :3] + transform[2, 3]
        near, far = min(near, float(depths.min())), max(far, float(depths.max()))
    return max(0.95 * near, 1e-3), 1.05 * far + 1e-3


def _open(resolution: int) -> Any:
    try:
        return _Offscreen(resolution, resolution)
    except Exception as error:  # the driver's own errors are of many kinds: EGLError, AssertionError, ValueError …
        raise RuntimeError(
            f"renderer pyrender: expected an EGL context, got {type(error).__name__}: {error}; "
            f'install {NEEDS["pyrender"]}, or use renderer = "embree"'
        ) from error
