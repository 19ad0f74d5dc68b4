"""Back-projection of exactly known token fields."""

from __future__ import annotations

from functools import cache
from typing import TypeVar

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.features import PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.extract import ExtractParams, extract
from b23d.stages.geometry.cameras import project
from b23d.stages.render import RenderParams, render
from tests.made_tokens import SQUARE, SQUARE_FACES, TOP, noise, sampled, seen, shape, token_views

Of = TypeVar("Of", Views, ViewTokens)


def test_constant_tokens_give_constant_features() -> None:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15))
    views = render(mesh, RenderParams(rings={"count": 2}))
    tokens = token_views(np.broadcast_to([1.5, -2, 0.25], (len(views.depth), 16, 16, 3)))
    for sample in ("nearest", "bilinear"):
        result = backproject(mesh, views, tokens, BackprojectParams(sample=sample))
        assert result.observed.mean() > 0.99
        np.testing.assert_array_equal(
            result.features[result.observed], np.tile([1.5, -2, 0.25], (result.observed.sum(), 1))
        )


@pytest.mark.parametrize("grid", [(16, 16), (7, 9)])
def test_a_linear_ramp_is_reproduced(grid: tuple[int, int]) -> None:
    """Token values that are the pixel coordinates of their centres: bilinear sampling returns each point's own
    pixel."""
    mesh = sampled(trimesh.creation.box((0.6, 0.5, 0.4)))
    views = render(mesh, RenderParams(rings={"count": 1}, distance=2.0))
    rows, columns = ((np.arange(n) + 0.5) * 224 / n for n in grid)
    ramp = np.stack(np.meshgrid(columns, rows), axis=-1)
    visible = seen(mesh, views)
    pixels, _ = project(mesh.points.astype(float), views.world_to_camera, views.intrinsics)
    expected = (pixels * visible[..., None]).sum(axis=0) / visible.sum(axis=0)[:, None]
    tokens = token_views(np.broadcast_to(ramp, (len(views.depth), *ramp.shape)))
    smooth = backproject(mesh, views, tokens, BackprojectParams()).features
    np.testing.assert_allclose(smooth, expected, atol=0.13)  # float16's spacing at 224 is .125
    nearest = backproject(mesh, views, tokens, BackprojectParams(sample="nearest")).features
    assert np.abs(nearest - expected).max() <= 224 / min(grid) / 2 + 0.13
    assert np.abs(nearest - expected).mean() > 1


def test_nearest_takes_the_token_of_the_patch() -> None:
    point = np.array([[0.2, 0, 0.1]])
    plane = shape(SQUARE, SQUARE_FACES, point)
    views = render(plane, RenderParams(rings={"count": 1}, distance=2.0))
    patch = np.zeros((len(views.depth), 8, 8, 1))
    pixel = project(point, views.world_to_camera, views.intrinsics)[0][TOP, 0]
    patch[TOP, int(pixel[1] // 28), int(pixel[0] // 28)] = 1
    result = backproject(plane, views, token_views(patch), BackprojectParams(sample="nearest"))
    assert result.features[0, 0] * result.counts[0] == pytest.approx(1, abs=1e-3)


def test_a_single_token_per_view() -> None:
    mesh = sampled(trimesh.creation.icosphere(radius=0.5))
    views = render(mesh, RenderParams(rings={"count": 1}))
    for sample in ("nearest", "bilinear"):
        result = backproject(
            mesh, views, token_views(np.ones((len(views.depth), 1, 1, 2))), BackprojectParams(sample=sample)
        )
        assert (result.features == 1).all()


def test_counts_times_features_is_the_sum() -> None:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15))
    views = render(mesh, RenderParams(rings={"count": 2}))
    tokens = noise(views)
    whole = backproject(mesh, views, tokens, BackprojectParams(sample="nearest"))
    pixels, _ = project(mesh.points.astype(float), views.world_to_camera, views.intrinsics)
    visible = seen(mesh, views)
    column, row = np.moveaxis((pixels // 32).astype(int), 2, 0)
    picked = tokens.grid()[np.arange(len(visible))[:, None], row, column].astype(float) * visible[..., None]
    np.testing.assert_allclose(whole.features * whole.counts[:, None].astype(float), picked.sum(axis=0), atol=0.02)
    np.testing.assert_array_equal(whole.observed, whole.counts > 0)
    assert whole.class_token is not None
    np.testing.assert_allclose(whole.class_token, np.asarray(tokens.class_tokens, float).mean(axis=0), rtol=1e-5)
    assert whole.descriptor == "test"


@cache
def small_torus() -> tuple[NormalizedShape, Views, ViewTokens]:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15), 200)
    views = render(mesh, RenderParams(rings={"count": 2}, resolution=64))
    return mesh, views, noise(views)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(14)))
def test_the_order_of_views_does_not_matter(order: list[int]) -> None:
    mesh, views, tokens = small_torus()
    a = backproject(mesh, views, tokens, BackprojectParams())
    b = backproject(mesh, permuted(views, order), permuted(tokens, order), BackprojectParams())
    close(a, b)


def permuted(of: Of, order: list[int]) -> Of:
    return of.model_copy(
        update={
            name: value[order]
            for name, value in of.present_arrays().items()
            if of.array_specs()[name].dims.startswith("view ")
        }
    )


def close(a: PointFeatures, b: PointFeatures) -> None:
    np.testing.assert_array_equal(a.counts, b.counts)
    np.testing.assert_allclose(a.features, b.features, atol=2e-3)


def test_tokens_of_other_views_are_an_error() -> None:
    mesh = sampled(trimesh.creation.icosphere(radius=0.5))
    views = render(mesh, RenderParams(rings={"count": 1}))
    with pytest.raises(ValueError, match="tokens: expected those of 6 views, got 5"):
        backproject(mesh, views, token_views(np.ones((5, 2, 2, 1))), BackprojectParams())


def test_features_do_not_depend_on_the_renderer() -> None:
    """A real encoder on both renderers' pictures: cosine > .99 at (almost) every point."""
    mesh = sampled(
        trimesh.util.concatenate(
            [
                trimesh.creation.torus(0.35, 0.1),
                trimesh.creation.box((0.2, 0.5, 0.9)),
                trimesh.creation.cylinder(0.05, 1.0),
            ]
        )
    )
    features = []
    for name in ("embree", "pyrender"):
        try:
            views = render(mesh, RenderParams(renderer=name, rings={"count": 1}, azimuth_offset=10))
            tokens = extract(views, ExtractParams(encoder="efficientnet-lite0"))
        except (RuntimeError, FileNotFoundError) as error:
            pytest.skip(str(error))
        features.append(backproject(mesh, views, tokens, BackprojectParams()).features.astype(float))
    a, b = features
    both = a.any(axis=1) & b.any(axis=1)
    cosine = np.einsum("nc,nc->n", a[both], b[both]) / np.linalg.norm(a[both], axis=1) / np.linalg.norm(b[both], axis=1)
    assert cosine.mean() > 0.998
    assert np.quantile(cosine, 0.01) > 0.99
