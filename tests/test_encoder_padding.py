"""Views that see different numbers of patches: together with padding, as on a card, or a group at a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from b23d.stages.encoders.encoder import Encoder
from tests.tiny_checkpoints import TINY, save
from tests.tiny_encoders import EMBEDDED, embedded, images, tiny

CARD = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {family: save(family, tmp_path_factory.mktemp(family)) for family in TINY}


@pytest.fixture
def as_on_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    """An encoder that is told of a card does as it would there, on the CPU where there is none."""
    if not torch.cuda.is_available():
        monkeypatch.setattr(Encoder, "_sent", lambda _encoder, values: values)


def some_patches(encoder: Encoder, views: int) -> np.ndarray:
    """From one patch of a view to all of them."""
    share = np.linspace(0, 1, views)[:, None, None]
    patches = np.random.default_rng(1).random((views, *encoder.grid)) < share
    patches[:, 0, 0] = True
    return patches


def near(got: np.ndarray | None, expected: np.ndarray | None) -> None:
    """Within half a thousandth of the largest value: float16's rounding."""
    assert (got is None) == (expected is None)
    if got is not None and expected is not None:
        a, b = got.astype(np.float32), expected.astype(np.float32)
        np.testing.assert_allclose(a, b, atol=5e-4 * np.abs(b).max(), rtol=0)


@pytest.mark.parametrize("family", TINY)
@pytest.mark.parametrize("batch", [None, 2])
@pytest.mark.usefixtures("as_on_a_card")
def test_padding_is_seen_by_no_token(folders: dict[str, Path], family: str, batch: int | None) -> None:
    encoder, views = tiny(folders, family), images(6, TINY[family].size)
    patches = some_patches(encoder, 6)
    tokens, classes = replace(encoder, device="cuda").encode(views, patches, batch)
    each = [encoder.encode(views[[i]], patches[[i]]) for i in range(6)]
    near(tokens, np.concatenate([one for one, _ in each]))
    near(classes, None if classes is None else np.concatenate([one for _, one in each if one is not None]))


@pytest.mark.usefixtures("as_on_a_card")
def test_a_card_is_given_a_shape_at_once(folders: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    passes: list[int] = []
    forward = Encoder._forward

    def counted(encoder: Encoder, given: np.ndarray, kept: torch.Tensor | None) -> object:
        passes.append(len(given))
        return forward(encoder, given, kept)

    monkeypatch.setattr(Encoder, "_forward", counted)
    encoder, views = tiny(folders, "dinov2"), images(9, 70)
    replace(encoder, device="cuda").encode(views, some_patches(encoder, 9))
    assert passes == [9]


@pytest.mark.usefixtures("as_on_a_card")
def test_where_the_cards_memory_ends_less_goes_at_a_time(
    folders: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    forward = Encoder._forward

    def small(encoder: Encoder, given: np.ndarray, kept: torch.Tensor | None) -> object:
        if len(given) > 2:
            raise torch.OutOfMemoryError("CUDA out of memory")
        return forward(encoder, given, kept)

    encoder, views = tiny(folders, "dinov2"), images(9, 70)
    card, patches = replace(encoder, device="cuda"), some_patches(encoder, 9)
    expected = card.encode(views, patches)
    monkeypatch.setattr(Encoder, "_forward", small)
    for got, whole in zip(card.encode(views, patches), expected, strict=True):
        near(got, whole)
    monkeypatch.setattr(Encoder, "_forward", lambda *_: (_ for _ in ()).throw(torch.OutOfMemoryError("full")))
    with pytest.raises(torch.OutOfMemoryError):
        card.encode(views, patches)


@CARD
@pytest.mark.parametrize("family", [*TINY, *EMBEDDED])
def test_a_card_gives_the_cpus_tokens(folders: dict[str, Path], family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """In fp32, to 2e-4 of the norm: products of matrices are summed in another order."""
    card = embedded(family, precision="fp32") if family in EMBEDDED else tiny(folders, family)
    views = images(5, card.input_size)
    patches = some_patches(card, 5)
    got = card.encode(views, patches)
    card.backbone.network.to("cpu")
    try:
        expected = replace(card, device="cpu").encode(views, patches)
    finally:
        card.backbone.network.to("cuda")
    for a, b in zip(got, expected, strict=True):
        if a is not None and b is not None:
            difference = np.linalg.norm(a.astype(np.float64) - b.astype(np.float64))
            assert difference <= 2e-4 * np.linalg.norm(b.astype(np.float64))
