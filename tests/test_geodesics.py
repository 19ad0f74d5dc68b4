"""The parts of geodesic: neighbour graph, all-pairs shortest paths, links between components, points inserted into a
mesh."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree
from scipy.spatial.distance import cdist

from b23d.stages.geodesics.bridging import WIDE, links
from b23d.stages.geodesics.dissection import LEAF, dissect
from b23d.stages.geodesics.graph import edge_graph, graph_distances, label_components, neighbour_edges
from b23d.stages.geodesics.insertion import insert_points
from b23d.stages.geodesics.paths import all_pairs
from tests.test_geodesic import cloud, sphere


@pytest.mark.parametrize("neighbors", [3, 12])
def test_divide_and_conquer_equals_dijkstra(neighbors: int) -> None:
    points = np.concatenate([cloud(700), cloud(300, seed=1) * 0.5 + [0, 0.4, 2], np.zeros((30, 3))])
    graph = edge_graph(len(points), *neighbour_edges(points, neighbors))
    assert label_components(graph).max() > 0
    np.testing.assert_allclose(all_pairs(graph, points), dijkstra(graph), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(all_pairs(graph, np.zeros_like(points)), dijkstra(graph), rtol=1e-5, atol=1e-7)


def test_no_edge_joins_the_two_sides_of_a_separator() -> None:
    points = np.concatenate([cloud(900), cloud(400, seed=1) * 0.5 + [0, 0.4, 2]])
    graph = edge_graph(len(points), *neighbour_edges(points, 8))
    order, parts = dissect(graph, points)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(points)))
    assert (parts[-1].start, parts[-1].stop) == (0, len(points))
    ordered = graph[order][:, order]
    made: set[tuple[int, int]] = set()
    for part in parts:
        assert not ordered[part.start : part.middle, part.middle : part.separator].nnz
        if part.start < part.separator:
            assert part.stop - part.separator <= (part.stop - part.start) // 3
            assert {(part.start, part.middle), (part.middle, part.separator)} <= made
        made.add((part.start, part.stop))
    assert max(part.stop - part.start for part in parts if part.start == part.separator) <= LEAF


def test_neighbours_are_the_nearest_others() -> None:
    points = np.concatenate([cloud(80), np.repeat(cloud(1), 30, axis=0)])
    edges, lengths = neighbour_edges(points, 5)
    assert (edges[:, 0] < edges[:, 1]).all()
    apart = cdist(points, points)
    np.fill_diagonal(apart, np.inf)
    degree = np.bincount(edges.ravel(), minlength=len(points))
    assert degree.min() >= 5
    nearest = np.sort(apart, axis=1)[:, 4]
    assert (lengths <= np.maximum(nearest[edges[:, 0]], nearest[edges[:, 1]]) + 1e-12).all()


def test_distances_from_a_few_sources_are_exact() -> None:
    points = np.concatenate([cloud(200), cloud(50) + np.array([0, 9, 0])]) * 37.0
    sources = np.array([3, 240, 3])
    graph = edge_graph(250, *neighbour_edges(points, 20))
    found = graph_distances(points, 20, sources)
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, dijkstra(graph, indices=sources))
    assert np.isinf(found[0, 240])
    assert np.isfinite(graph_distances(points, 20, sources, disconnected="bridge")).all()
    assert graph_distances(points, 20, np.array([], int)).shape == (0, 250)
    with pytest.raises(ValueError, match="expected indices below 250"):
        graph_distances(points, 20, np.array([250]))
    with pytest.raises(ValueError, match="all finite"):
        graph_distances(points * np.nan, 20, sources)


def test_links_hold_the_shortest_that_connect_and_none_much_longer() -> None:
    rng = np.random.default_rng(0)
    components = rng.permutation(np.arange(90) % 9)
    points = rng.random((90, 3)) * 0.3 + 3 * rng.random((9, 3))[components]
    ends, lengths = links(points, components)
    np.testing.assert_allclose(lengths, np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1))
    between = np.full((9, 9), np.inf)
    np.minimum.at(between, tuple(components[ends].T), lengths)
    between = np.where(np.isinf(np.minimum(between, between.T)), 0, np.minimum(between, between.T))
    gaps = np.array(
        [[cdist(points[components == a], points[components == b]).min() for b in range(9)] for a in range(9)]
    )
    tree = minimum_spanning_tree(gaps).toarray()
    np.testing.assert_allclose(minimum_spanning_tree(between).sum(), tree.sum())
    widest = gaps.copy()
    for by in range(9):
        widest = np.minimum(widest, np.maximum(widest[:, by, None], widest[by]))
    assert (lengths <= WIDE * widest[tuple(components[ends].T)] + 1e-12).all()
    for one, other in ends:
        rows = [cdist(points[[a]], points[components == components[b]]).min() for a, b in ((one, other), (other, one))]
        length = np.linalg.norm(points[one] - points[other])
        assert min(abs(row - length) for row in rows) < 1e-12, "the nearest of its component, seen from one end"


def test_components_that_coincide_are_linked_at_no_length() -> None:
    ends, lengths = links(np.zeros((3, 3)), np.array([0, 1, 2]))
    assert len(ends) == 3
    assert (lengths == 0).all()


def test_a_strip_cut_out_of_a_plate_is_crossed_straight() -> None:
    plate = np.random.default_rng(0).uniform(-0.5, 0.5, (3000, 3)) * [1, 0, 1]
    slanted = plate[:, 0] + 0.1 * plate[:, 2]  # the strip is .12 wide at one end and .2 at the other
    points = plate[np.abs(slanted) > 0.06 + 0.04 * (plate[:, 2] + 0.5)]
    found = graph_distances(points, 20, np.arange(50), disconnected="bridge")
    straight = cdist(points[:50], points)
    ratio = found[straight > 0.3] / straight[straight > 0.3]
    assert ratio.min() >= 1 - 1e-9 and np.quantile(ratio, 0.95) < 1.1, "a plate's distances are straight ones"


def test_inserted_points_are_vertices_and_the_surface_stays() -> None:
    ball = sphere(2000)
    twice = np.concatenate([np.arange(2000), [5, 5]])
    vertices, faces, at = insert_points(
        ball.vertices.astype(np.float64), ball.faces, ball.point_faces[twice], ball.point_barycentrics[twice]
    )
    assert len(vertices) == len(ball.vertices) + 2000
    assert len(faces) == len(ball.faces) + 2 * 2000
    assert at[5] == at[2000] == at[2001]
    np.testing.assert_allclose(vertices[at], ball.points[twice], atol=2e-4)
    assert (np.unique(faces) == np.arange(len(vertices))).all()

    def total(v: np.ndarray, f: np.ndarray) -> float:
        return float(np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1).sum())

    np.testing.assert_allclose(total(vertices, faces), total(ball.vertices.astype(np.float64), ball.faces), rtol=1e-6)


def test_points_at_corners_and_on_edges_can_be_inserted() -> None:
    corners = np.array([[1, 0, 0], [0, 1, 0], [0.5, 0.5, 0], [0, 0.5, 0.5], [1 / 3, 1 / 3, 1 / 3]])
    vertices, _, at = insert_points(np.eye(3), np.array([[0, 1, 2]]), np.zeros(5, int), corners)
    np.testing.assert_allclose(vertices[at], corners, atol=5e-3)
