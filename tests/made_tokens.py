"""Shapes and view tokens whose back-projection is known."""

from __future__ import annotations

import numpy as np
import trimesh

from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.encoders.patches import nearest_kept
from b23d.stages.geometry.cameras import project
from b23d.stages.renderers.visibility import by_depth


def shape(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, point_faces: np.ndarray | None = None
) -> NormalizedShape:
    return NormalizedShape(
        kind="mesh" if len(faces) else "cloud",
        vertices=np.asarray(vertices, np.float32),
        faces=np.asarray(faces, np.int32).reshape(-1, 3),
        points=np.asarray(points, np.float32),
        point_faces=np.asarray(np.full(len(points), -1) if point_faces is None else point_faces, np.int32),
        point_barycentrics=np.zeros((len(points), 3), np.float32),
        candidates="fps",
        center=(0, 0, 0),
        scale=1,
        repairs={},
    )


def sampled(mesh: trimesh.Trimesh, count: int = 500) -> NormalizedShape:
    points, point_faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    return shape(mesh.vertices, mesh.faces, points, point_faces)


def token_views(tokens: np.ndarray, class_tokens: np.ndarray | None = None) -> ViewTokens:
    kept = np.ones(tokens.shape[:3], bool)
    return ViewTokens(
        tokens=tokens.reshape(-1, tokens.shape[-1]).astype(np.float16),
        rows=nearest_kept(kept),
        kept=kept,
        class_tokens=class_tokens,
        encoder="test",
        weights="none",
    )


def noise(views: Views, channels: int = 5, grid: int = 7) -> ViewTokens:
    random = np.random.default_rng(0)
    count = len(views.depth)
    return token_views(
        random.normal(size=(count, grid, grid, channels)), random.normal(size=(count, channels)).astype(np.float16)
    )


def seen(of: NormalizedShape, views: Views, tolerance: float = 0.0025) -> np.ndarray:
    return by_depth(*project(of.points.astype(float), views.world_to_camera, views.intrinsics), views.depth, tolerance)


SQUARE = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])
TOP, BOTTOM = 0, -1
