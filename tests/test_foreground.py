"""Encoding the foreground alone: which patches, what a transformer then sees, and what is kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.runfile.config import load_config
from b23d.schemas.params import missing_choice
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.encoders.encoder import Encoder
from b23d.stages.encoders.interface import Backbone, Pixels
from b23d.stages.encoders.load import load_encoder
from b23d.stages.encoders.names import FAMILIES
from b23d.stages.encoders.patches import foreground_patches, nearest_kept, with_background, with_ring
from b23d.stages.encoders.weights import find_checkpoint
from b23d.stages.extract import ExtractParams, Foreground, extract
from b23d.stages.render import RenderParams, render
from tests.made_shapes import BOX, of_mesh
from tests.tiny_checkpoints import TINY, save

RUNS = Path(__file__).parents[1] / "runs"
LEAVES_OUT = [family for family in TINY if family not in ("sam", "efficientnet")]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(1, 7), st.integers(5, 12))
def test_a_patch_is_foreground_if_any_pixel_in_it_is(seed: int, i: int, j: int, side: int) -> None:
    ids = np.where(np.random.default_rng(seed).random((2, side, side)) < 0.15, 3, -1).astype(np.int32)
    ids[:, side // 2, side // 2] = 0
    expected = np.zeros((2, i, j), bool)
    for view, row, column in np.argwhere(ids >= 0):
        for a in range(i):
            for b in range(j):
                # the pixel covers [row, row + 1) × [column, column + 1)
                across = a * side / i < row + 1 and row < (a + 1) * side / i
                expected[view, a, b] |= across and b * side / j < column + 1 and column < (b + 1) * side / j
    np.testing.assert_array_equal(foreground_patches(ids, (i, j)), expected)


def test_a_view_that_shows_nothing_has_all_its_patches() -> None:
    ids = np.full((2, 8, 8), -1)
    ids[1, 0, 0] = 5
    assert foreground_patches(ids, (4, 4)).sum(axis=(1, 2)).tolist() == [16, 1]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 20), st.floats(0.01, 1))
def test_background_is_added_up_to_a_multiple_of_eight(seed: int, background: int, share: float) -> None:
    foreground = np.random.default_rng(seed).random((3, 6, 6)) < share
    chosen = with_background(foreground, background, seed)
    own, count = foreground.sum(axis=(1, 2)), chosen.sum(axis=(1, 2))
    assert chosen[foreground].all()
    assert ((count == 36) | ((count % 8 == 0) & (count >= own + background) & (count < own + background + 8))).all()
    np.testing.assert_array_equal(chosen, with_background(foreground, background, seed))


def test_the_seed_chooses_the_background() -> None:
    foreground = np.zeros((4, 16, 16), bool)
    foreground[:, 4:8, 4:8] = True
    assert (with_background(foreground, 8, 0) != with_background(foreground, 8, 1)).any()
    first, second = with_background(foreground, 8, 0)[:2]
    assert (first != second).any()  # other patches in every view


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_nearest_kept_patch_stands_for_the_others(seed: int) -> None:
    random = np.random.default_rng(seed)
    kept = random.random((3, 5, 7)) < 0.2
    kept[:, random.integers(5), random.integers(7)] = True
    rows, places = nearest_kept(kept), np.argwhere(kept)
    np.testing.assert_array_equal(rows[kept], np.arange(kept.sum()))
    for view, i, j in np.argwhere(~kept):
        away = np.hypot(*(places[:, 1:] - (i, j)).T)
        away[places[:, 0] != view] = np.inf
        assert away[rows[view, i, j]] == away.min()


def test_a_ring_is_what_bilinear_sampling_reaches() -> None:
    foreground = np.zeros((2, 5, 5), bool)
    foreground[0, 2, 2] = True
    assert with_ring(foreground).sum(axis=(1, 2)).tolist() == [9, 0]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {family: save(family, tmp_path_factory.mktemp(family)) for family in LEAVES_OUT}


def tiny(folders: dict[str, Path], family: str) -> Encoder:
    size = TINY[family].size if family.startswith("dino") else None
    return load_encoder(find_checkpoint(f"test/{family}", folders[family]), input_size=size, precision="fp32")


def noise(encoder: Encoder, count: int) -> np.ndarray:
    size = encoder.input_size
    return np.random.default_rng(0).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def some(encoder: Encoder, count: int) -> np.ndarray:
    patches = np.random.default_rng(1).random((count, *encoder.grid)) < 0.5
    patches[:, 0, 1] = True
    return patches


@pytest.mark.parametrize("family", LEAVES_OUT)
def test_patches_left_out_are_as_if_nobody_attended_to_them(
    folders: dict[str, Path], family: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the whole picture goes through, with -inf for the attention paid to what is left out."""
    encoder = tiny(folders, family)
    views, patches = noise(encoder, 3), some(encoder, 3)
    got, _ = encoder.encode(views, patches)
    attend = torch.nn.functional.scaled_dot_product_attention
    whole = []
    for view, kept in zip(views, patches, strict=True):
        there = torch.ones(TINY[family].prefix + kept.size, dtype=torch.bool)
        there[TINY[family].prefix :] = torch.from_numpy(kept.ravel())

        def masked(query: Tensor, key: Tensor, value: Tensor, there: Tensor = there, **options: Any) -> Tensor:
            assert key.shape[-2] == len(there)
            return attend(query, key, value, attn_mask=there.expand(query.shape[-2], -1), scale=options.get("scale"))

        monkeypatch.setattr(torch.nn.functional, "scaled_dot_product_attention", masked)
        whole.append(encoder.encode(view[None])[0][kept.ravel()])
    expected = np.concatenate(whole).astype(np.float32)
    np.testing.assert_allclose(got, expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("family", LEAVES_OUT)
def test_what_is_left_out_cannot_be_seen(folders: dict[str, Path], family: str) -> None:
    encoder = tiny(folders, family)
    views, patches = noise(encoder, 2), some(encoder, 2)
    side = encoder.input_size // encoder.grid[0]
    painted = np.where(patches.repeat(side, axis=1).repeat(side, axis=2)[..., None], views, 7).astype(np.uint8)
    for before, after in zip(encoder.encode(views, patches), encoder.encode(painted, patches), strict=True):
        if before is not None and after is not None:
            np.testing.assert_array_equal(before, after)
    assert (encoder.encode(views)[0] != encoder.encode(painted)[0]).any()


class Echo(nn.Module):
    """Tokens are their patches' numbers; memory ends at more than three views."""

    most = 3

    def __init__(self) -> None:
        super().__init__()
        self.batches: list[int] = []

    def forward(self, pixels: Tensor, kept: Tensor | None) -> tuple[Tensor, Tensor]:
        if len(pixels) > self.most:
            raise torch.OutOfMemoryError("out of memory")
        self.batches.append(len(pixels))
        places = torch.arange(16).expand(len(pixels), -1) if kept is None else kept
        return places[..., None].float(), pixels.mean((1, 2, 3))[:, None]


def echo() -> tuple[Encoder, Echo]:
    network = Echo()
    backbone = Backbone(network, Pixels(4, (0.0,) * 3, (1.0,) * 3), (4, 4), 1, True, False, 64)  # type: ignore[arg-type]
    return Encoder("echo", "none", backbone, "fp32", "cpu"), network


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.booleans())
def test_tokens_come_back_in_order_however_views_are_grouped(seed: int, batch: int, whole: bool) -> None:
    random = np.random.default_rng(seed)
    patches = random.random((9, 4, 4)) < random.random((9, 1, 1))
    patches[:, 1, 1] = True
    encoder, network = echo()
    encoder = replace(encoder, backbone=replace(encoder.backbone, whole=whole))
    views = np.broadcast_to(np.arange(9, dtype=np.uint8)[:, None, None, None], (9, 4, 4, 3)).copy()
    tokens, classes = encoder.encode(views, patches, batch)
    np.testing.assert_array_equal(tokens[:, 0], np.nonzero(patches.reshape(9, -1))[1])
    assert classes is not None
    np.testing.assert_array_equal(classes[:, 0], np.arange(9))
    assert sum(network.batches) == 9


def test_batches_are_halved_where_memory_ends() -> None:
    encoder, network = echo()
    encoder.encode(np.zeros((8, 4, 4, 3), np.uint8))
    assert network.batches == [2, 2, 2, 2]
    network.most = 0
    with pytest.raises(torch.OutOfMemoryError):
        encoder.encode(np.zeros((8, 4, 4, 3), np.uint8))


def test_a_view_without_patches_is_an_error() -> None:
    patches = np.ones((2, 4, 4), bool)
    patches[1] = False
    with pytest.raises(ValueError, match="with at least one in every view"):
        echo()[0].encode(np.zeros((2, 4, 4, 3), np.uint8), patches)


@pytest.fixture(scope="module")
def box() -> tuple[NormalizedShape, Views]:
    shape = of_mesh(BOX.vertices, BOX.faces)
    return shape, render(shape, RenderParams(rings={"count": 1}, resolution=112))


def test_convolutions_give_the_same_features_from_fewer_tokens(box: tuple[NormalizedShape, Views]) -> None:
    foreground, whole = (extract(box[1], ExtractParams(tokens=tokens)) for tokens in ("foreground", "all"))  # type: ignore[arg-type]
    assert len(foreground.tokens) < 0.8 * len(whole.tokens)
    np.testing.assert_array_equal(foreground.grid()[foreground.kept], whole.grid()[foreground.kept])
    few, all_of_them = (backproject(*box, tokens, BackprojectParams()) for tokens in (foreground, whole))
    np.testing.assert_array_equal(few.features, all_of_them.features)


def test_transformers_keep_tokens_of_the_foreground(
    box: tuple[NormalizedShape, Views], folders: dict[str, Path]
) -> None:
    params = ExtractParams(encoder="test/tiny", weights=folders["dinov2"], input_size=112, precision="fp32")
    found = extract(box[1], params)
    np.testing.assert_array_equal(found.kept, foreground_patches(box[1].face_ids, (8, 8)))
    assert len(found.tokens) == found.kept.sum() < found.kept.size
    for changed in (Foreground(background=20), Foreground(seed=1), "all"):
        other = extract(box[1], params.model_copy(update={"tokens" if changed == "all" else "foreground": changed}))
        assert (other.grid()[found.kept] != found.tokens).any()


@pytest.mark.parametrize("family", TINY)
def test_what_a_transformer_sees_besides_enters_addresses_of_transformers_alone(family: str, tmp_path: Path) -> None:
    folder = save(family, tmp_path)
    size = TINY[family].size if family.startswith("dino") else None
    encoder = load_encoder(find_checkpoint("test/any", folder), input_size=size, precision="fp32")
    architecture = json.loads((folder / "config.json").read_text())["model_type"]
    (known,) = (one for one in FAMILIES if architecture in one.model_type)
    assert known.whole == encoder.whole
    for name in known.hub:
        params = ExtractParams(encoder=name)
        assert ("foreground" in params.hashed()) == (not encoder.whole)
        assert "foreground" in params.model_copy(update={"weights": folder}).hashed()


def test_the_default_encoder_sees_whole_pictures() -> None:
    assert "foreground" not in ExtractParams().hashed()
    assert "foreground" in ExtractParams(encoder="saliency-vit-s14").hashed()


def test_what_a_transformer_sees_besides_cannot_be_set_for_another_encoder() -> None:
    params = ExtractParams(foreground={"background": 3})  # type: ignore[arg-type]
    encoder, got, other = missing_choice(params, ["foreground", "background"]) or ("", "", "")
    assert (encoder, got) == ("encoder", "efficientnet-lite0")
    assert missing_choice(params.model_copy(update={encoder: other}), ["foreground", "background"]) is None
    none = params.model_copy(update={encoder: other, "tokens": "all"})
    assert missing_choice(none, ["foreground", "background"]) == ("tokens", "all", "foreground")
    with pytest.raises(RunFileError, match=r"encoder = efficientnet-lite0.*--set stages\.extract\.encoder="):
        load_config(RUNS / "demo.toml", ["stages.extract.foreground.background=3"])
