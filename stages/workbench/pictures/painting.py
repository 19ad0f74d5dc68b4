"""Small pictures of shapes, drawn in numpy: discs at points, near ones over far ones. No renderer, no GPU.

The camera looks from the front right, a little from above (KeypointNet's and ShapeNet's front is -z), without
perspective.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views
from b23d.stages.geometry.cameras import rotations
from b23d.stages.workbench.pictures.palette import id_color
from b23d.stages.workbench.pictures.surface import point_normals
from b23d.stages.workbench.results.gathering import ShapeResults

DIRECTION = np.deg2rad(np.array([[145.0, 22.0]]))  # azimuth from +z towards +x, elevation
LIGHT = np.array([0.35, 0.8, -0.5]) / np.linalg.norm([0.35, 0.8, -0.5])
GREY = (176, 182, 190)
LEAST, MOST = (
    12_000,
    150_000,
)  # points that stand for a mesh's surface: a quarter of the picture's pixels, between these
MARGIN = 0.06
SUPERSAMPLED = 2


@dataclass(frozen=True)
class Mark:
    """A keypoint on a picture."""

    position: np.ndarray
    """(3,), unit frame."""
    id: int
    true: bool
    """Drawn as a ring; predicted ones as discs."""


def picture(shape: NormalizedShape, colors: np.ndarray | None, size: int, keypoints: Iterable[Mark] = ()) -> np.ndarray:
    """(size, size, 4) uint8, transparent where the shape is not. `colors` (n, 3) uint8 of the candidates; None: grey.

    Predicted and true keypoints of one id are joined by a line.
    """
    points, normals, near, spacing = _surface_points(shape, size)
    base = np.full((len(points), 3), GREY, np.float64) if colors is None else colors[near].astype(np.float64)
    shade = 0.45 + 0.55 * np.abs(normals @ LIGHT)
    eye = rotations(DIRECTION)[0]
    seen = points @ eye.T
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    pixels = size * SUPERSAMPLED
    scale = (1 - 2 * MARGIN) * pixels / max(float((high - low).max()), 1e-6)
    offset = pixels / 2 - scale * (low + high) / 2
    colored = np.clip(base * shade[:, None], 0, 255)
    canvas = _splat(seen[:, :2] * scale + offset, seen[:, 2], colored, pixels, max(1.5, scale * spacing))
    return _shrunk(_marked(canvas, list(keypoints), eye, scale, offset))


def view_picture(views: Views, size: int) -> np.ndarray:
    """(size, size, 4) uint8: the stored view nearest to this module's direction, its white background made
    transparent."""
    from PIL import Image

    image = views.images[nearest_view(views)]
    there = (image != 255).any(axis=2)
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    rgba = np.dstack([image, np.where(there, 255, 0).astype(np.uint8)])
    if len(rows):
        middle = np.array([rows[0] + rows[-1], columns[0] + columns[-1]]) / 2
        half = max(np.ptp(rows), np.ptp(columns)) / 2 * (1 + 2 * MARGIN) + 1
        box = (middle[1] - half, middle[0] - half, middle[1] + half, middle[0] + half)
        return np.asarray(
            Image.fromarray(rgba).resize((size, size), Image.Resampling.BILINEAR, box=_inside(box, rgba.shape))
        )
    return np.asarray(Image.fromarray(rgba).resize((size, size)))


def nearest_view(views: Views) -> int:
    """Which stored view is nearest to this module's direction."""
    azimuth, elevation = DIRECTION[0]
    wanted = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    eyes = -np.einsum("vji,vj->vi", views.world_to_camera[:, :3, :3], views.world_to_camera[:, :3, 3])
    return int((eyes @ wanted / np.linalg.norm(eyes, axis=1)).argmax())


def marks(entry: ShapeResults, prediction: Prediction) -> list[Mark]:
    """Marks of the keypoints judged present and of the annotated ones."""
    found = zip(prediction.ids, prediction.positions, prediction.present, strict=True)
    truth = entry.keypoints.ids if entry.keypoints is not None else ()
    predicted = [Mark(at, int(number), False) for number, at, present in found if present]
    return predicted + [Mark(at, int(number), True) for number, at in zip(truth, entry.true_positions(), strict=True)]


def webp(image: np.ndarray, quality: int = 80) -> bytes:
    """(row, column, 4) uint8 as a WebP file."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "WEBP", quality=quality, method=4)
    return stream.getvalue()


def _surface_points(shape: NormalizedShape, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Points (m, 3), normals (m, 3), each one's nearest candidate (m,), and a disc's radius that leaves few gaps, unit
    frame.

    Many points of a mesh, the candidates of a cloud.
    """
    if shape.kind == "cloud":
        return (
            shape.points.astype(np.float64),
            point_normals(shape),
            np.arange(len(shape.points)),
            0.7 * _spacing(shape.points),
        )
    from scipy.spatial import cKDTree

    from b23d.stages.geometry.cleaning import areas
    from b23d.stages.geometry.sampling import surface_samples

    count = min(max(LEAST, size**2 // 4), MOST)
    on = surface_samples(shape.vertices, shape.faces, count, np.random.default_rng(0))
    corners = shape.vertices[shape.faces[on.faces]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    _, near = cKDTree(shape.points).query(on.points)
    each = areas(shape.vertices, shape.faces).sum() / count  # of the surface, a point's share
    return on.points.astype(np.float64), normals, near, 1.25 * float(np.sqrt(each))


def _spacing(points: np.ndarray) -> float:
    """Median distance to the third nearest neighbour."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=min(4, len(points)))
    return float(np.median(distances.reshape(len(points), -1)[:, -1]))


def _splat(at: np.ndarray, depth: np.ndarray, colors: np.ndarray, pixels: int, radius: float) -> np.ndarray:
    """(pixels, pixels, 4) uint8: a disc at every point; where discs meet, the nearest point's is seen."""
    reach = int(np.ceil(radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = np.stack([x, y], axis=-1)[x**2 + y**2 <= radius**2]  # (d, 2)
    far_first = np.argsort(-depth, kind="stable")
    covered = np.round(at[far_first]).astype(np.int32)[:, None] + disc.astype(np.int32)  # (n, d, 2)
    covered = np.clip(covered, 0, pixels - 1)
    owner = np.full(pixels * pixels, -1, np.int32)
    owner[covered[..., 1] * pixels + covered[..., 0]] = np.arange(len(at), dtype=np.int32)[
        :, None
    ]  # later ones overwrite
    rgba = np.concatenate([colors[far_first], np.full((len(at), 1), 255)], axis=1).astype(np.uint8)
    return np.concatenate([rgba, np.zeros((1, 4), np.uint8)])[owner].reshape(pixels, pixels, 4)


def _marked(canvas: np.ndarray, keypoints: list[Mark], eye: np.ndarray, scale: float, offset: np.ndarray) -> np.ndarray:
    from PIL import Image, ImageDraw

    if not keypoints:
        return canvas
    image = Image.fromarray(canvas)
    draw, pixels = ImageDraw.Draw(image), len(canvas)
    radius, line = pixels * 0.023, max(2, round(pixels * 0.008))
    places = {(mark.true, mark.id): (mark.position @ eye.T)[:2] * scale + offset for mark in keypoints}
    for (true, number), place in places.items():
        if not true and (True, number) in places:
            draw.line([tuple(place), tuple(places[True, number])], fill=(220, 38, 38, 255), width=line)
    for (true, number), (x, y) in sorted(places.items(), reverse=True):
        box = (x - radius, y - radius, x + radius, y + radius)
        if true:
            draw.ellipse(box, outline=(255, 255, 255, 255), width=line + 4)
            draw.ellipse(box, outline=(17, 24, 39, 255), width=line)
        else:
            inner = (x - radius * 0.72, y - radius * 0.72, x + radius * 0.72, y + radius * 0.72)
            draw.ellipse(inner, fill=id_color(number), outline=(255, 255, 255, 255), width=2)
    return np.asarray(image)


def _shrunk(canvas: np.ndarray) -> np.ndarray:
    """Mean of 2 × 2 pixels, colours weighted by their opacity."""
    size = len(canvas) // SUPERSAMPLED
    blocks = canvas.reshape(size, SUPERSAMPLED, size, SUPERSAMPLED, 4).astype(np.float64)
    alpha = blocks[..., 3].sum(axis=(1, 3))
    color = (blocks[..., :3] * blocks[..., 3:]).sum(axis=(1, 3)) / np.maximum(alpha, 1)[..., None]
    return np.dstack([color, alpha / SUPERSAMPLED**2]).round().astype(np.uint8)


def _inside(box: tuple[float, float, float, float], shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    left, top, right, bottom = box
    return max(0.0, left), max(0.0, top), min(float(shape[1]), right), min(float(shape[0]), bottom)
