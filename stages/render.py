"""render: a shape seen from all sides, in grey or in its colours, with depth, faces and cameras."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from b23d.pipeline.stage import stage
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views
from b23d.stages.geometry.cameras import fibonacci_angles, fitting_distance, look_at_origin, pinhole, ring_angles
from b23d.stages.renderers import RendererName, renderer
from b23d.stages.renderers.shading import ShadedSurface, shade, smooth_normals


class Rings(Params):
    count: PositiveInt = 5
    """The paper's n: n rings of 2(n + 1) viewpoints, top and bottom, 2n(n + 1) + 2 views in all; 5 gives 62."""


class Fibonacci(Params):
    views: PositiveInt = 62
    """How many, top to bottom."""


class RenderParams(Params):
    """From where, how large, and in what light. The paper gives 62 views on 5 rings and a light at the camera; the rest
    is ours."""

    layout: Literal["rings", "fibonacci"] = "rings"
    """Viewpoints on equi-angular rings, with top and bottom (DIFFERENCES.md, row 21); or on a Fibonacci sphere."""
    rings: Annotated[Rings, When(layout="rings")] = Rings()
    fibonacci: Annotated[Fibonacci, When(layout="fibonacci")] = Fibonacci()
    azimuth_offset: float = 0.0
    """Degrees by which all viewpoints are turned about the up axis (towards +x from +z)."""
    resolution: int = Field(default=224, ge=16)
    """Rows and columns of a view, in pixels."""
    field_of_view: float = Field(default=60.0, gt=0, lt=180)
    """Degrees from side to side."""
    distance: PositiveFloat | Literal["fit"] = "fit"
    """Camera's distance from the origin, unit frame. "fit": the least at which the shape is in the frame in every view
    (DIFFERENCES.md, row 20). A number that leaves any of it outside is an error."""
    distance_factor: Annotated[float, When(distance="fit")] = Field(default=1.0, ge=1)
    """Multiplies the fitted distance (the paper's "relative render distance")."""
    margin: Annotated[float, When(distance="fit")] = Field(default=0.05, ge=0, lt=1)
    """Share of the half side kept free at every edge by "fit"."""
    renderer: RendererName = "embree"
    """"embree": ray casting on the CPU; "pyrender": OpenGL through EGL. They agree but for roundings at edges."""
    shading: Literal["flat", "smooth"] = "flat"
    """Normals of the faces (robust on dirty meshes), or interpolated between vertices as the paper's renderer did.
    Point clouds have no faces: theirs are always interpolated."""
    albedo: float = Field(default=0.7, ge=0, le=1)
    """Grey of an untextured surface."""
    ambient: float = Field(default=0.3, ge=0, le=1)
    """Share of the light that comes from everywhere; the rest comes from the camera."""
    texture: bool = False
    """Draw the shape's texture or else its vertex colours, where it has any, instead of grey."""
    disc_radius: PositiveFloat = 2.0
    """Point clouds: how far a point's disc may reach, in multiples of the local spacing (distance to the 6th
    neighbour)."""
    disc_neighbours: int = Field(default=24, ge=3)
    """Point clouds: neighbours that make a disc's plane and outline."""


@stage(version=3)
def render(normalize: NormalizedShape, params: RenderParams) -> Views:
    """Pictures, depth and face ids of a shape from all viewpoints, in the order of `ring_angles` or `fibonacci_angles`.

    A cloud's `face_ids` are indices of its points (`normalize.vertices`), a mesh's of its faces. Raises ValueError
    where there is nothing to draw, or where a `distance` in numbers leaves part of the shape outside the frame;
    RuntimeError where the renderer has no device.
    """
    surface, ids = _cloud(normalize, params) if normalize.kind == "cloud" else _mesh(normalize, params)
    angles = _angles(params)
    seen = np.concatenate([surface.vertices[np.unique(surface.faces)], normalize.points])
    distance = _distance(seen, angles, params)
    world_to_camera = look_at_origin(angles, distance)
    intrinsics = pinhole(params.resolution, params.field_of_view)
    rasterize = renderer(params.renderer)
    raster = rasterize(surface.vertices, surface.faces, world_to_camera, intrinsics, params.resolution)
    images = shade(surface, raster, world_to_camera, intrinsics, params.albedo, params.ambient)
    return Views(
        images=images,
        depth=raster.depth,
        face_ids=raster.face_ids if ids is None else np.append(ids, np.int32(-1))[raster.face_ids],
        world_to_camera=world_to_camera,
        intrinsics=intrinsics,
        renderer=params.renderer,
        distance=distance,
    )


def _angles(params: RenderParams) -> np.ndarray:
    rings = params.layout == "rings"
    angles = ring_angles(params.rings.count) if rings else fibonacci_angles(params.fibonacci.views)
    return angles + np.array([np.deg2rad(params.azimuth_offset), 0.0])


def _distance(points: np.ndarray, angles: np.ndarray, params: RenderParams) -> float:
    if params.distance == "fit":
        return params.distance_factor * fitting_distance(points, angles, params.field_of_view, params.margin)
    least = fitting_distance(points, angles, params.field_of_view, margin=0.0)
    if params.distance < least:
        raise ValueError(
            f"distance: expected at least {least:.4f} to have the whole shape in every view, got {params.distance}; "
            'raise it, widen field_of_view, or use "fit"'
        )
    return params.distance


def _mesh(shape: NormalizedShape, params: RenderParams) -> tuple[ShadedSurface, None]:
    """The surface to draw; its triangles are the shape's faces."""
    if len(shape.faces) == 0:
        raise ValueError("mesh: expected faces to render, got none; give its points as a cloud")
    has_texture = params.texture and shape.texture is not None and shape.face_uvs is not None
    surface = ShadedSurface(
        shape.vertices,
        shape.faces,
        corner_normals=smooth_normals(shape.vertices, shape.faces) if params.shading == "smooth" else None,
        corner_colors=_colors(shape.vertex_colors, shape.faces) if params.texture and not has_texture else None,
        corner_uvs=shape.face_uvs if has_texture else None,
        texture=shape.texture if has_texture else None,
    )
    return surface, None


def _cloud(shape: NormalizedShape, params: RenderParams) -> tuple[ShadedSurface, np.ndarray]:
    """The surface to draw, and the cloud's point that each of its triangles belongs to. Very large clouds are drawn
    from some of their points (`drawn_points`)."""
    from b23d.stages.renderers.discs import TRIANGLES_PER_DISC, discs, drawn_points

    points = drawn_points(shape.vertices)
    drawn = discs(shape.vertices[points], params.disc_neighbours, params.disc_radius)
    surface = ShadedSurface(
        drawn.vertices,
        drawn.faces,
        corner_normals=drawn.normals[drawn.faces],
        corner_colors=_colors(shape.vertex_colors, points[drawn.sources[drawn.faces]]) if params.texture else None,
    )
    return surface, np.repeat(points, TRIANGLES_PER_DISC).astype(np.int32)


def _colors(colors: np.ndarray | None, corners: np.ndarray) -> np.ndarray | None:
    """(f, 3, 3) in [0, 1] of the vertices `corners` (f, 3)."""
    return None if colors is None else colors[corners].astype(np.float32) / 255
