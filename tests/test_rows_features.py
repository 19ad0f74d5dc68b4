"""The rows of the table of differences on candidates, views, features and distances, each on a case made to show it.

`test_rows.py` has the table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from b23d.schemas.keypoints import Keypoints
from b23d.schemas.views import Views
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.extract import ExtractParams, extract
from b23d.stages.geometry.cameras import project
from b23d.stages.render import RenderParams, render
from b23d.stages.score import ScoreParams, score
from tests.made_shapes import BOX, of_mesh
from tests.made_tokens import SQUARE, SQUARE_FACES, TOP, noise, sampled, shape, token_views
from tests.test_geodesic import plate
from tests.test_geodesic import shape as bare
from tests.test_geodesic import solve as geodesics
from tests.test_reweight import RELEASED, distances, random_case, seen
from tests.test_reweight import line as beads
from tests.test_reweight import run as smooth
from tests.test_score import predicted
from tests.tiny_checkpoints import TINY, library, save


def test_row_02_batches_change_the_result_only_as_released() -> None:
    points, geodesic = random_case(7)
    few, many = (smooth(points, geodesic, sigma=0.1, batches=b, **RELEASED) for b in (2, 8))
    assert np.abs(few - many).max() > 0.1
    # One smoothing after all views: smoothing what two halves of the views saw, and adding up, is the same.
    rng = np.random.default_rng(8)
    halves = [seen(rng.normal(size=(40, 5)), np.ones(40)) for _ in range(2)]
    together = seen(np.mean([h.features.astype(np.float32) for h in halves], axis=0), np.full(40, 2))
    apart = np.mean([smooth(h, geodesic, sigma=0.1) for h in halves], axis=0)
    np.testing.assert_allclose(smooth(together, geodesic, sigma=0.1), apart, atol=3e-3)


def test_row_02_unnormalised_sums_grow_with_density() -> None:
    at = np.concatenate([np.linspace(0, 0.01, 9), [1.0]])
    crowd, alone = smooth(seen(np.ones((10, 1))), distances(np.abs(at[:, None] - at)), sigma=0.1, normalised=False)[
        [0, -1]
    ]
    assert crowd > 5 * alone


def test_row_03_views_weighting_depends_on_how_many_views_saw_a_point() -> None:
    points, geodesic = random_case(2)
    uneven = seen(points.features, points.counts * np.arange(1, 41))
    once, often = (smooth(p, geodesic, sigma=0.2) for p in (points, uneven))
    np.testing.assert_array_equal(once, often)
    once, often = (smooth(p, geodesic, sigma=0.2, weight="views") for p in (points, uneven))
    assert np.abs(once - often).max() > 0.1


def test_row_04_background_sees_the_last_face_and_a_face_is_seen_whole() -> None:
    mesh = sampled(trimesh.creation.icosphere(subdivisions=2, radius=0.5))
    views = render(mesh, RenderParams(rings={"count": 2}))
    point, face = (
        backproject(mesh, views, noise(views), BackprojectParams(visibility=v)).counts for v in ("point", "face")
    )
    assert (face >= point).all()
    last = mesh.point_faces == len(mesh.faces) - 1
    assert (face[last] == len(views.depth)).all()
    assert (point[last] < 0.7 * len(views.depth)).all()


def test_row_05_far_unseen_points_are_filled_where_the_released_weights_underflow() -> None:
    points = seen(np.full((20, 4), 7.0), np.r_[3, np.zeros(19)])
    for sigma in (1e-4, 1e-3, 0.01):
        np.testing.assert_allclose(smooth(points, beads(20), sigma=sigma), 7.0)
        assert (smooth(points, beads(20), sigma=sigma, fill="zeros")[-1] == 0).all()


def test_row_06_sigma_is_a_length_of_the_unit_frame_and_a_thousandth_smooths_nothing() -> None:
    i = np.arange(2048)
    angle, height = i * np.pi * (3 - 5**0.5), 1 - (2 * i + 1) / 2048
    ball = (
        np.stack([np.cos(angle) * np.sqrt(1 - height**2), height, np.sin(angle) * np.sqrt(1 - height**2)], axis=1) / 2
    )
    apart = np.arccos(np.clip(4 * ball @ ball.T, -1, 1))
    np.fill_diagonal(apart, np.inf)
    apart *= 0.015 / apart.min(1).mean()  # as candidates of real shapes lie
    np.fill_diagonal(apart, 0)
    points, geodesic = seen(np.random.default_rng(0).normal(size=(2048, 8))), distances(apart)
    moved = {
        s: np.abs(smooth(points, geodesic, sigma=s) - points.features).max()
        for s in (0.001, 0.001 * apart.max(), 0.01, 0.03)
    }
    assert list(moved.values())[:2] == [0, 0]
    assert 0.1 < moved[0.01] < moved[0.03]


def test_row_08_a_thin_plate_is_crossed_only_by_what_keeps_short_cuts() -> None:
    """Top to bottom at the plate's middle is a whole unit along the surface, and .01 straight through."""
    thin = plate()
    top, bottom = (thin.points[:, 1] > 0.004), (thin.points[:, 1] < -0.004)
    middle = (np.abs(thin.points[:, [0, 2]]) < 0.1).all(axis=1)
    across = np.ix_(top & middle, bottom & middle)
    assert geodesics(thin)[across].max() < 0.4
    assert geodesics(thin, shortcuts="cut")[across].min() > 0.75
    assert geodesics(thin, method="heat")[across].min() > 0.75


def test_row_08_parts_apart_are_bridged_or_as_far_as_can_be() -> None:
    pieces = bare(np.array([[x, 0.0, 0.0] for x in (0, 0.1, 0.2, 0.5, 0.6)]))
    bridged, largest = (geodesics(pieces, neighbors=1, disconnected=how) for how in ("bridge", "max"))
    assert bridged[2, 3] == pytest.approx(0.3, rel=1e-3)
    assert largest[2, 3] == pytest.approx(0.2, rel=1e-3)  # the largest of any part, whatever lies between


def test_row_12_the_cloud_has_the_annotated_points_and_samples_have_not() -> None:
    cloud = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3)) * BOX.extents
    cloud[:, 0] = np.sign(cloud[:, 0]) * BOX.extents[0] / 2
    truth = Keypoints(ids=np.arange(3, dtype=np.int32), positions=cloud[:3], point_indices=np.arange(3, dtype=np.int32))
    hits = {}
    for kind in ("cloud", "fps"):
        made = of_mesh(BOX.vertices, BOX.faces, cloud, candidates=kind)
        nearest = np.linalg.norm(made.points[:, None] - made.to_unit(cloud[:3]), axis=2).argmin(0)
        prediction = predicted([0, 1, 2], [0, 0, 0]).model_copy(update={"points": nearest.astype(np.int32)})
        best = score(made, prediction, truth, [truth], ScoreParams(units="unit"))
        hits[kind] = best.true_positives[0]
        assert f"candidates {kind}" in best.protocol
    assert hits == {"cloud": 3, "fps": 0}


def bare_views(side: int) -> Views:
    """One view that is one colour all over."""
    blank = np.zeros((1, side, side))
    return Views(
        images=np.full((1, side, side, 3), (10, 120, 240), np.uint8),
        depth=blank.astype(np.float32),
        face_ids=blank.astype(np.int32) - 1,
        world_to_camera=np.eye(4)[None],
        intrinsics=np.eye(3),
        renderer="none",
        distance=2.0,
    )


def test_row_18_sam_sees_views_in_its_own_size_and_normalisation(tmp_path: Path) -> None:
    blank = bare_views(32)
    own = np.broadcast_to(blank.images[:, :1, :1], (1, TINY["sam"].size, TINY["sam"].size, 3))
    params = ExtractParams(encoder="sam-vit-base", weights=save("sam", tmp_path), precision="fp32")
    tokens = extract(blank, params).grid()
    expected = library("sam", tmp_path, own.copy())[0][-1].numpy()
    np.testing.assert_allclose(tokens.astype(float), expected, atol=2e-3 * np.abs(expected).max())
    with pytest.raises(ValueError, match="SAM's only one, got 64"):
        extract(blank, params.model_copy(update={"input_size": 64}))


def test_row_19_points_of_one_patch_share_its_token_or_have_their_own_mixture() -> None:
    plane = shape(SQUARE, SQUARE_FACES, np.array([[0.20, 0, 0.1], [0.22, 0, 0.1]]))
    views = render(plane, RenderParams(rings={"count": 1}, distance=2.0))
    pixels = project(plane.points.astype(float), views.world_to_camera, views.intrinsics)[0][TOP]
    assert len({(int(y // 28), int(x // 28)) for x, y in pixels}) == 1
    tokens = token_views(np.random.default_rng(0).normal(size=(len(views.depth), 8, 8, 3)))
    tokens.tokens[64:] = 0  # the top view alone
    nearest, bilinear = (
        backproject(plane, views, tokens, BackprojectParams(sample=s)).features for s in ("nearest", "bilinear")
    )
    assert (nearest[0] == nearest[1]).all()
    assert np.abs(bilinear[0] - bilinear[1].astype(float)).max() > 0.01


@pytest.mark.parametrize("sides", [(1.0, 1.0, 1.0), (1.0, 0.01, 0.01)])
def test_row_20_the_shape_fits_the_frame_or_the_distance_is_an_error(sides: tuple[float, float, float]) -> None:
    box = trimesh.creation.box(sides)
    made = shape(box.vertices, box.faces, box.vertices)
    views = render(made, RenderParams(rings={"count": 2}, resolution=64))
    pixels, depths = project(box.vertices, views.world_to_camera, views.intrinsics)
    assert ((pixels > 0) & (pixels < 64)).all() and (depths > 0).all()
    with pytest.raises(ValueError, match="distance: expected at least"):
        render(made, RenderParams(rings={"count": 2}, resolution=64, distance=0.6))


def test_row_21_five_rings_are_sixty_two_views_and_a_fibonacci_sphere_spreads_them() -> None:
    box = trimesh.creation.box()
    made = shape(box.vertices / 2, box.faces, box.vertices / 2)
    for rings in (1, 5):
        views = render(made, RenderParams(rings={"count": rings}, resolution=16))
        assert len(views.depth) == 2 * rings * (rings + 1) + 2

    def nearest(layout: str) -> np.ndarray:
        away = render(made, RenderParams(layout=layout, resolution=16)).world_to_camera[:, 2, :3]
        angles = np.degrees(np.arccos(np.clip(away @ away.T, -1, 1))) + 360 * np.eye(len(away))
        return np.asarray(angles.min(1))

    assert nearest("rings").min() == pytest.approx(14.9, abs=0.1)  # crowded on the rings next to the poles
    assert nearest("fibonacci").min() > 20
    assert len(nearest("fibonacci")) == 62
