"""The plain counterpart of every stage: what one would write first with numpy, scipy, trimesh and transformers.

Those of learn and optimize solve the paper's objective, which is another problem than the posterior's, in loops.
"""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.encoders.encoder import Encoder
from b23d.stages.geodesics.graph import edge_graph, neighbour_edges
from b23d.stages.geometry.cameras import pixel_rays, project
from b23d.stages.geometry.sampling import surface_samples
from b23d.stages.renderers.visibility import by_depth

COUNT = 2048


def normalize(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Farthest points among ten times as many samples, one after another."""
    samples = surface_samples(vertices, faces, 10 * COUNT, np.random.default_rng(0)).points
    chosen, away = [0], np.full(len(samples), np.inf)
    for _ in range(COUNT - 1):
        away = np.minimum(away, ((samples - samples[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(away.argmax()))
    return samples[chosen]


def render(shape: NormalizedShape, views: Views) -> np.ndarray:
    """trimesh's ray caster for every pixel, and the cosine of the face."""
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    rays = pixel_rays(views.intrinsics, views.depth.shape[1]).reshape(-1, 3)
    images = np.full((len(views.depth), len(rays)), 255, np.uint8)
    for image, transform in zip(images, views.world_to_camera, strict=True):
        directions = rays @ transform[:3, :3]
        origins = np.broadcast_to(-transform[:3, 3] @ transform[:3, :3], directions.shape)
        hit = mesh.ray.intersects_first(origins, directions)
        cosine = np.abs((mesh.face_normals[hit] * directions).sum(axis=1)) / np.linalg.norm(directions, axis=1)
        image[hit >= 0] = (255 * 0.7 * (0.3 + 0.7 * cosine))[hit >= 0]
    return images


def extract(views: Views, encoder: Encoder) -> list[np.ndarray]:
    """Every patch of every view in float32, eight views at a time."""
    found = []
    with torch.inference_mode():
        for start in range(0, len(views.images), 8):
            levels = torch.from_numpy(views.images[start : start + 8]).permute(0, 3, 1, 2)
            found.append(encoder.backbone.network(encoder.backbone.pixels.normalized(levels))[0].numpy())
    return found


def backproject(shape: NormalizedShape, views: Views, tokens: ViewTokens) -> np.ndarray:
    """A loop over views: upsample the tokens to pixels' places, add them where the view sees the point."""
    pixels, depths = project(shape.points.astype(np.float64), views.world_to_camera, views.intrinsics)
    seen = by_depth(pixels, depths, views.depth, 0.0025)
    sums = np.zeros((len(shape.points), tokens.tokens.shape[1]))
    for view, grid in enumerate(tokens.grid()):
        at = torch.from_numpy(pixels[view] / views.depth.shape[1] * 2 - 1).float()[None, None]
        image = torch.from_numpy(grid.astype(np.float32)).permute(2, 0, 1)[None]
        sampled = torch.nn.functional.grid_sample(image, at, padding_mode="border", align_corners=False)
        sums += sampled[0, :, 0].T.numpy() * seen[view][:, None]
    return sums / np.maximum(seen.sum(axis=0), 1)[:, None]


def geodesic(points: np.ndarray, neighbors: int = 20) -> np.ndarray:
    """scipy's Dijkstra from every point."""
    found = cKDTree(points).query(points, neighbors + 1)[1][:, 1:]
    edges = np.column_stack([np.repeat(np.arange(len(points)), neighbors), found.ravel()])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    return dijkstra(edge_graph(len(points), edges, np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)))


def reweight(features: PointFeatures, distances: GeodesicDistances, sigma: float = 0.01) -> np.ndarray:
    """All weights, all products, in double precision."""
    weights = np.exp(-(distances.distances.astype(np.float64) ** 2) / (2 * sigma**2)) * features.observed
    return weights @ features.features.astype(np.float64) / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)


Shot = tuple[PointFeatures, GeodesicDistances, np.ndarray, np.ndarray]
"""Its keypoints' ids and candidates last."""
Learnt = tuple[list[int], np.ndarray, np.ndarray]


def learn(shots: list[Shot]) -> Learnt:
    """Ids; each one's mean feature (k, channel), and their mean distances from each other (k, k)."""
    ids = sorted({int(one) for *_, named, _ in shots for one in named})
    features: list[list[np.ndarray]] = [[] for _ in ids]
    apart: list[list[list[float]]] = [[[] for _ in ids] for _ in ids]
    for own, distances, named, candidates in shots:
        at = dict(zip(named.tolist(), candidates.tolist(), strict=True))
        for row, first in enumerate(ids):
            if first not in at:
                continue
            features[row].append(own.features[at[first]].astype(np.float64))
            for column, second in enumerate(ids):
                if second in at:
                    apart[row][column].append(float(distances.distances[at[first], at[second]]))
    means = np.array([[np.mean(pair) if pair else np.nan for pair in row] for row in apart])
    return ids, np.array([np.mean(rows, axis=0) for rows in features]), means


def optimize(learnt: Learnt, own: PointFeatures, distances: GeodesicDistances, alpha: float = 0.25) -> np.ndarray:
    """(k,) candidates: the paper's objective minimised one keypoint after the other, ten times over, from the nearest
    features."""
    _, features, apart = learnt
    costs = ((own.features.astype(np.float64)[None] - features[:, None]) ** 2).sum(axis=2)
    choice, between = costs.argmin(axis=1), distances.distances.astype(np.float64)
    for _ in range(10):
        for row in range(len(choice)):
            others = [k for k in range(len(choice)) if k != row and np.isfinite(apart[row, k])]
            stretch = sum((np.abs(between[:, choice[k]] - apart[row, k]) for k in others), np.zeros(len(between)))
            choice[row] = (costs[row] + alpha * stretch).argmin()
    return choice


def score(points: np.ndarray, predicted: np.ndarray, annotated: np.ndarray, thresholds: np.ndarray) -> list[float]:
    """IoU at every threshold: Dijkstra from every predicted point, one threshold after the other."""
    graph = edge_graph(len(points), *neighbour_edges(points, 20))
    distances = np.array([dijkstra(graph, indices=at)[annotated] for at in predicted])
    found = []
    for threshold in thresholds:
        hits = distances <= threshold
        true = hits.any(axis=0).sum()
        found.append(true / (len(annotated) + (~hits.any(axis=1)).sum()))
    return found
