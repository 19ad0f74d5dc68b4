"""normalize: a shape's files → one clean mesh or cloud in the unit frame, with the candidate points everything else
lives on."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.orientation import Orientation
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape, Source, turned
from b23d.schemas.up_axis import UpAxis, to_y_up

if TYPE_CHECKING:
    from b23d.stages.geometry.cleaning import Clean
    from b23d.stages.geometry.surface import Cloud, Surface

OFF_SURFACE = 0.05
"""A cloud whose median point is farther than this from its mesh (unit frame) does not belong to it."""


class NormalizeParams(Params):
    """How a shape becomes a unit-frame shape with candidates."""

    candidates: Literal["auto", "cloud", "fps"] = "auto"
    """Candidate points: `cloud` = the data set's cloud in its own order (KeypointNet's protocol; the cloud contains the
    annotated points); `fps` = farthest-point samples of the surface, or of the cloud where there is no mesh; `auto` =
    the cloud where there is one of at most `cloud_limit` points, else fps."""
    count: Annotated[int, When(candidates=("auto", "fps"))] = Field(2048, ge=1)
    """How many farthest-point samples (fewer only where a bare cloud has fewer points)."""
    cloud_limit: Annotated[int, When(candidates="auto")] = Field(4096, ge=1)
    """Largest cloud that `auto` takes whole: distances between candidates grow with the square, and a cloud that has
    lost some of its points should not have more candidates for that."""
    seed: Annotated[int, When(candidates=("auto", "fps")), When(turn="random")] = Field(0, ge=0)
    """Of the random surface points that farthest-point sampling chooses from."""
    max_nonfinite: float = Field(0.01, ge=0, le=1)
    """Fraction of vertices or points that may be NaN or infinite and are repaired; above it the shape is an error."""
    turn: float | Literal["random"] = 0.0
    """Degrees by which the upright shape is turned about the up axis (from +z towards +x) before anything else, its
    annotations with it; "random": another angle for every shape, from `seed`. To measure what a method owes to a common
    orientation."""
    stray: Literal["drop", "keep"] = "drop"
    """What to do with points and specks that are few, small, and apart from all else (a scan's outliers, and what flies
    about its surface). "drop": the frame is the box of the rest; stray faces go, a cloud's stray points are put where
    others of it are, here and there."""
    watertight: bool = False
    """Replace each mesh by a closed manifold around it, for descriptors that need clean meshes (the paper's HKS, WKS,
    SHOT). Candidates are sampled on that, or the data set's cloud stays and is tied to it; frame and annotations stay;
    colours and textures are dropped. Meshes that are one closed surface already, and clouds, stay as they are."""
    watertight_resolution: Annotated[int, When(watertight=True)] = Field(64, ge=8, le=128)
    """Cells along the shape's longest side: gaps and holes narrower than some 1.7 cells are closed, faces grow with the
    square."""
    colors: bool = True
    """Read colours and textures. Without, every shape is plain grey, and texture files that fail cannot hurt."""


@stage(version=5, hints=Hints(memory_gb=0.5))
def normalize(source: Source, params: NormalizeParams, orient: Orientation | None = None) -> NormalizedShape:
    """Read, set upright (the source's `up` axis, or the one that `orient` found, becomes +y), clean, move to the unit
    frame, and choose candidates.

    The frame is the box of the vertices that clean faces use (of the cloud's points where there is no mesh). Vertices
    keep the file's number and order. Faces with a non-finite, repeated or collinear corner, and faces that cover the
    same three places as an earlier one (either way round), are dropped, and so is what is `stray`; all are counted in
    `repairs`.

    Raises ValueError, naming the shape: empty or unreadable file; neither faces nor points; a face index out of range;
    all faces degenerate; more than `max_nonfinite` of the coordinates not finite; fewer than 2 distinct points; `cloud`
    candidates without a cloud; a cloud that does not lie on its mesh.
    """
    from b23d.stages.geometry.loading import load
    from b23d.stages.geometry.surface import Cloud

    if source.mesh is None and source.cloud is None:
        raise ValueError(f"{source.shape}: expected a mesh or a cloud, got neither; add a file or remove the shape")
    cloud = (
        load(source.shape, source.files, source.cloud, params.colors, source.own_names)
        if source.cloud is not None
        else None
    )
    if cloud is not None and not isinstance(cloud, Cloud):
        cloud = Cloud(cloud.vertices, cloud.vertex_colors, problems=cloud.problems)
    mesh = (
        load(source.shape, source.files, source.mesh, params.colors, source.own_names)
        if source.mesh is not None
        else None
    )
    if isinstance(mesh, Cloud):  # a mesh format that holds points only
        mesh, cloud = None, cloud or mesh
    turn, up = _turn(source.shape, params), source.up or (orient.axis if orient is not None else "y")
    if cloud is not None:
        cloud = _finite(source.shape, cloud, params)
        cloud = replace(cloud, points=_turned(cloud.points, up, turn))
    if mesh is not None:
        vertices = _turned(mesh.vertices, up, turn)
        made = _mesh(source.shape, replace(mesh, vertices=vertices), cloud, params)
    else:
        assert cloud is not None
        made = _cloud(source.shape, cloud, params)
    return made.model_copy(update={"turn": turn, "up": up})


def _turn(shape: str, params: NormalizeParams) -> float:
    if params.turn != "random":
        return params.turn
    digest = hashlib.sha256(f"{params.seed} {shape}".encode()).digest()
    return 360.0 * int.from_bytes(digest[:4], "big") / 2**32


def _turned(positions: np.ndarray, up: UpAxis, turn: float) -> np.ndarray:
    """Source frame (n, 3) → upright and turned. Where nothing turns, values move and none changes, infinite or not."""
    rows = to_y_up(up)
    places, signs = np.abs(rows).argmax(1), rows.sum(1)
    upright = positions if up == "y" else positions[:, places] * signs
    with np.errstate(invalid="ignore", over="ignore"):  # vertices that no face uses may be anywhere
        return upright @ turned(turn).T if turn else upright


def _mesh(shape: str, surface: Surface, cloud: Cloud | None, params: NormalizeParams) -> NormalizedShape:
    from b23d.stages.geometry.cleaning import clean
    from b23d.stages.geometry.nearest import nearest_on_faces
    from b23d.stages.geometry.sampling import DENSITY, farthest_points, surface_samples
    from b23d.stages.geometry.watertight import one_closed_surface

    _check_finite(shape, surface.vertices, params, "vertices")
    result = clean(surface.vertices, surface.faces, shape)
    if params.stray == "drop":
        result = _without_stray(result, surface, shape)
    replaced = params.watertight and not one_closed_surface(result.vertices, result.faces)
    if replaced:
        result = _closed(result, params.watertight_resolution)
    kind = _kind(shape, cloud, params)
    if kind == "cloud" and cloud is not None:
        points = result.frame.unit(cloud.points).astype(np.float32)
        on, distance = nearest_on_faces(points, result.vertices, result.faces)
        if (away := float(np.median(distance))) > OFF_SURFACE:
            raise ValueError(
                f"{shape}: expected its cloud on its mesh, got a median distance of {away:.2g} of the longest side; "
                'bring both into one frame, leave one out, or set stages.normalize.candidates = "fps"'
            )
    else:
        rng = np.random.default_rng(params.seed)
        dense = surface_samples(result.vertices, result.faces, DENSITY * params.count, rng)
        on = dense[farthest_points(dense.points, params.count)]
        points = on.points
    colors, uvs, texture = _appearance(surface, result.kept) if params.colors and not replaced else (None, None, None)
    return NormalizedShape(
        kind="mesh",
        vertices=result.vertices,
        faces=result.faces,
        vertex_colors=colors,
        face_uvs=uvs,
        texture=texture,
        points=points,
        point_faces=on.faces,
        point_barycentrics=on.barycentrics,
        candidates=kind,
        center=_triple(result.frame.center),
        scale=result.frame.scale,
        repairs={
            **result.repairs,
            **({"non_finite_points": cloud.repaired, **cloud.problems} if cloud is not None else {}),
            **surface.problems,
        },
    )


def _without_stray(result: Clean, surface: Surface, shape: str) -> Clean:
    """The clean mesh without its stray faces, in the frame of the rest; as it is where it has none."""
    from b23d.stages.geometry.cleaning import clean
    from b23d.stages.geometry.stray import stray_faces

    repairs, strays = result.repairs, 0
    while (stray := stray_faces(result.vertices, result.faces)).any():
        strays += int(stray.sum())
        kept = result.kept[~stray]
        rest = clean(surface.vertices, surface.faces[kept], shape)
        result = replace(rest, kept=kept[rest.kept], repairs={**repairs, "stray_faces": strays})
    return result


def _closed(result: Clean, resolution: int) -> Clean:
    """The clean mesh's watertight one in the same frame; counts how many edges were not in exactly two faces, and its
    faces."""
    from b23d.stages.geometry.watertight import uneven_edges, watertight

    vertices, faces = watertight(result.vertices, result.faces, resolution)
    counts = {"uneven_edges": uneven_edges(result.faces), "watertight_faces": len(faces)}
    return replace(result, vertices=vertices, faces=faces, kept=result.kept[:0], repairs={**result.repairs, **counts})


def _cloud(shape: str, cloud: Cloud, params: NormalizeParams) -> NormalizedShape:
    from b23d.stages.geometry.cleaning import Frame, check_frame
    from b23d.stages.geometry.sampling import farthest_points
    from b23d.stages.geometry.stray import MOST, stray_points

    frame, points, strays = check_frame(Frame.around(cloud.points), shape), cloud.points, 0
    while params.stray == "drop" and (stray := stray_points(frame.unit(points))).any():
        if strays + stray.sum() > MOST * len(points):
            break
        strays += int(stray.sum())
        points = _elsewhere(points, stray)
        frame = check_frame(Frame.around(points), shape)
    vertices = frame.unit(points).astype(np.float32)
    kind = _kind(shape, cloud, params)
    points = vertices if kind == "cloud" else vertices[farthest_points(vertices, params.count)]
    return NormalizedShape(
        kind="cloud",
        vertices=vertices,
        faces=np.zeros((0, 3), np.int32),
        vertex_colors=cloud.colors,
        points=points,
        point_faces=np.full(len(points), -1, np.int32),
        point_barycentrics=np.zeros((len(points), 3), np.float32),
        candidates=kind,
        center=_triple(frame.center),
        scale=frame.scale,
        repairs={
            "non_finite_points": cloud.repaired,
            **({"stray_points": strays} if strays else {}),  # clean shapes' artifacts stay what they were
            **cloud.problems,
        },
    )


def _elsewhere(points: np.ndarray, stray: np.ndarray) -> np.ndarray:
    """The points (n, 3), those that are stray (n,) put where others are, as far from each other in the file as can
    be."""
    kept, moved = np.flatnonzero(~stray), points.copy()
    moved[stray] = points[kept[np.arange(int(stray.sum())) * len(kept) // int(stray.sum())]]
    return moved


def _kind(shape: str, cloud: Cloud | None, params: NormalizeParams) -> Literal["cloud", "fps"]:
    if params.candidates == "cloud" and cloud is None:
        raise ValueError(
            f'{shape}: expected a point cloud for candidates = "cloud", got a mesh alone; add the cloud or set '
            'stages.normalize.candidates = "auto" or "fps"'
        )
    if params.candidates == "fps" or cloud is None:
        return "fps"
    return "cloud" if params.candidates == "cloud" or len(cloud.points) <= params.cloud_limit else "fps"


def _finite(shape: str, cloud: Cloud, params: NormalizeParams) -> Cloud:
    """The cloud with its non-finite points put on finite neighbours, and how many those were."""
    from b23d.stages.geometry.cleaning import fill_gaps
    from b23d.stages.geometry.surface import Cloud

    bad = _check_finite(shape, cloud.points, params, "points")
    return Cloud(fill_gaps(cloud.points), cloud.colors, bad, cloud.problems)


def _check_finite(shape: str, points: np.ndarray, params: NormalizeParams, what: str) -> int:
    from b23d.stages.geometry.cleaning import finite_rows

    bad = len(points) - int(finite_rows(points).sum())
    if bad > params.max_nonfinite * len(points) or bad == len(points):
        raise ValueError(
            f"{shape}: expected finite {what}, got {bad} of {len(points)} NaN or infinite; "
            "mend the file, remove the shape, or raise stages.normalize.max_nonfinite"
        )
    return bad


def _appearance(surface: Surface, kept: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    """(vertex_colors, face_uvs, texture) of the kept faces. Images win over vertex colours, those over plain
    materials."""
    from b23d.stages.geometry.atlas import bake

    pictured = any(material.image is not None for material in surface.materials)
    if surface.vertex_colors is not None and not pictured:
        return surface.vertex_colors, None, None
    if surface.face_materials is None:
        return None, None, None
    baked = bake(
        surface.materials, surface.face_materials[kept], None if surface.face_uvs is None else surface.face_uvs[kept]
    )
    return (None, None, None) if baked is None else (None, *baked)


def _triple(center: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in center)
    return x, y, z
