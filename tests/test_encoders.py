"""Every encoder family against the library's own forward pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from b23d.stages.encoders.interface import Pixels
from b23d.stages.encoders.load import load_encoder
from b23d.stages.encoders.weights import find_checkpoint
from tests.tiny_checkpoints import TINY, library, save
from tests.tiny_encoders import EMBEDDED, close, cosines, embedded, grids, images, prepared, tiny


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {family: save(family, tmp_path_factory.mktemp(family)) for family in TINY}


@pytest.mark.parametrize("family", TINY)
def test_default_tokens_are_the_librarys(folders: dict[str, Path], family: str) -> None:
    encoder, views = tiny(folders, family), images(3, TINY[family].size)
    tokens, classes = grids(encoder, views)
    _, expected, expected_class = library(family, folders[family], views)
    assert (
        tokens.dtype == np.float16
        and encoder.grid == (TINY[family].grid,) * 2
        and tokens.shape == (3, *encoder.grid, encoder.channels)
    )
    close(tokens, expected)
    assert (classes is None) == (expected_class is None) == (not encoder.class_token)
    if classes is not None and expected_class is not None:
        close(classes, expected_class)


@pytest.mark.parametrize("family", TINY)
def test_blocks_are_the_librarys_hidden_states(folders: dict[str, Path], family: str) -> None:
    norm = None if family in ("sam", "efficientnet") else False
    wanted = (3, 4) if family == "efficientnet" else (0, 1)
    views = images(2, TINY[family].size)
    states, _, _ = library(family, folders[family], views)
    close(grids(tiny(folders, family, wanted, norm), views)[0], torch.cat([states[block] for block in wanted], -1))


@pytest.mark.parametrize("family", [*(family for family in TINY if family != "efficientnet"), *EMBEDDED])
def test_token_ij_is_about_patch_ij(folders: dict[str, Path], family: str) -> None:
    encoder = embedded(family, precision="fp32") if family in EMBEDDED else tiny(folders, family)
    size = encoder.input_size
    patch, (row, column) = size // encoder.grid[0], (1, 2)
    plain = np.full((1, size, size, 3), 120, np.uint8)
    marked = plain.copy()
    marked[:, row * patch : (row + 1) * patch, column * patch : (column + 1) * patch] = (255, 30, 0)
    change = np.linalg.norm(grids(encoder, marked)[0].astype(float) - grids(encoder, plain)[0], axis=-1)[0]
    assert np.unravel_index(change.argmax(), change.shape) == (row, column)


@pytest.mark.parametrize("family", ["clip", "siglip", "siglip2", "dinov2", "dinov3"])
def test_another_input_size_interpolates_positions(folders: dict[str, Path], family: str) -> None:
    own = tiny(folders, family)
    patch = own.input_size // own.grid[0]
    larger = tiny(folders, family, input_size=own.input_size + 2 * patch)
    tokens, _ = grids(larger, images(1, own.input_size))
    assert larger.grid == (own.grid[0] + 2,) * 2 == tokens.shape[1:3] and np.isfinite(tokens).all()


def test_clip_class_token_is_normed_at_any_block(folders: dict[str, Path]) -> None:
    views = images(1, 32)
    with_norm = tiny(folders, "clip", (1, 2), True).encode(views)
    without = tiny(folders, "clip", (1, 2)).encode(views)
    np.testing.assert_array_equal(with_norm[1], without[1])
    assert not np.allclose(with_norm[0], without[0])


def test_siglip_pools_the_last_block_only(folders: dict[str, Path]) -> None:
    assert tiny(folders, "siglip", (2,)).class_token and not tiny(folders, "siglip", (1,)).class_token


def test_pytorch_model_bin_loads_without_code(folders: dict[str, Path], tmp_path: Path) -> None:
    from safetensors.torch import load_file

    for name in ("config.json", "preprocessor_config.json"):
        (tmp_path / name).write_bytes((folders["dinov2"] / name).read_bytes())
    torch.save(load_file(folders["dinov2"] / "model.safetensors"), tmp_path / "pytorch_model.bin")
    views = images(1, 70)
    from_bin = load_encoder(find_checkpoint("test/bin", tmp_path), (), None, 70, "fp32").encode(views)[0]
    np.testing.assert_array_equal(from_bin, tiny(folders, "dinov2").encode(views)[0])


def test_pickled_code_is_refused(folders: dict[str, Path], tmp_path: Path) -> None:
    (tmp_path / "config.json").write_bytes((folders["dinov2"] / "config.json").read_bytes())
    torch.save({"a": Path}, tmp_path / "pytorch_model.bin")
    with pytest.raises(ValueError, match="got files that do not load"):
        load_encoder(find_checkpoint("test/evil", tmp_path))


def test_missing_tensor_is_named(folders: dict[str, Path], tmp_path: Path) -> None:
    from safetensors.torch import load_file, save_file

    tensors = load_file(folders["dinov2"] / "model.safetensors")
    tensors.pop("layernorm.weight")
    save_file(tensors, tmp_path / "model.safetensors", {"format": "pt"})
    (tmp_path / "config.json").write_bytes((folders["dinov2"] / "config.json").read_bytes())
    with pytest.raises(ValueError, match=r"expected all weights of a Dinov2Model, got none for layernorm.weight"):
        load_encoder(find_checkpoint("test/holes", tmp_path))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"blocks": (7,)}, r"expected blocks from 0 to 2, got \[7\]"),
        ({"input_size": 75}, "a multiple of its patch, 14, got 75; take 70"),
    ],
)
def test_wrong_options_are_errors(folders: dict[str, Path], options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tiny(folders, "dinov2", **options)


def test_options_an_encoder_lacks_are_errors(folders: dict[str, Path]) -> None:
    with pytest.raises(ValueError, match=r"expected no stages.extract.layernorm"):
        tiny(folders, "sam", layernorm=True)
    with pytest.raises(ValueError, match=r"expected stages.extract.input_size 80, SAM's only one, got 96"):
        tiny(folders, "sam", input_size=96)
    with pytest.raises(ValueError, match="of one grid"):
        tiny(folders, "efficientnet", (0, 4))


def test_bad_images_and_overflow_are_errors(folders: dict[str, Path], tmp_path: Path) -> None:
    encoder = tiny(folders, "dinov2")
    for bad in (
        np.zeros((1, 70, 70, 3), np.float32),
        np.zeros((70, 70, 3), np.uint8),
        np.zeros((0, 70, 70, 3), np.uint8),
    ):
        with pytest.raises(ValueError, match="expected images uint8"):
            encoder.encode(bad)
    loud = load_encoder(
        find_checkpoint("test/loud", save("clip", tmp_path, image_std=[1e-9] * 3)), (0,), None, None, "fp32"
    )
    loud.backbone.network.layers[0].mlp.fc2.weight.mul_(1e6)
    with pytest.raises(ValueError, match="float16's range"):
        loud.encode(images(1, 32))


@pytest.mark.parametrize("name", [*EMBEDDED, "dinov2", "efficientnet"])
def test_batch_size_changes_nothing(folders: dict[str, Path], name: str) -> None:
    encoder = embedded(name, precision="fp32") if name in EMBEDDED else tiny(folders, name)
    views = images(3, encoder.input_size)
    one, many = encoder.encode(views, batch=1), encoder.encode(views, batch=2)
    close(one[0], torch.from_numpy(many[0].astype(np.float32)), 1e-3)
    if one[1] is not None and many[1] is not None:
        close(one[1], torch.from_numpy(many[1].astype(np.float32)), 1e-3)


def test_resizing_is_pils() -> None:
    from PIL import Image

    view = np.kron(images(1, 40), np.ones((1, 8, 8, 1), np.uint8))
    for size, mode, resampling in (
        (224, "bicubic", Image.Resampling.BICUBIC),
        (500, "bilinear", Image.Resampling.BILINEAR),
    ):
        pixels = Pixels(size, (0.0,) * 3, (1.0,) * 3, mode)  # type: ignore[arg-type]
        got = prepared(pixels, view)[0].permute(1, 2, 0)
        error = np.abs(got.numpy() - np.asarray(Image.fromarray(view[0]).resize((size, size), resampling), np.float32))
        assert error.max() <= 2 and error.mean() < 0.1  # each of the two passes rounds


def test_efficientnet_normalises_twice_as_its_processor(folders: dict[str, Path], tmp_path: Path) -> None:
    from transformers.models.efficientnet.image_processing_pil_efficientnet import EfficientNetImageProcessorPil

    size = {"height": 96, "width": 96}
    processor = EfficientNetImageProcessorPil(
        image_mean=[0.485, 0.456, 0.406], image_std=[0.4785, 0.4733, 0.4743], size=size
    )
    save("efficientnet", tmp_path)
    processor.save_pretrained(tmp_path)
    pixels = load_encoder(find_checkpoint("test/b", tmp_path)).backbone.pixels
    view = images(1, 96)
    expected = torch.as_tensor(np.asarray(processor(view[0])["pixel_values"][0]))
    torch.testing.assert_close(prepared(pixels, view)[0], expected.to(torch.float32), atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("family", TINY)
def test_every_family_runs_in_bf16(folders: dict[str, Path], family: str) -> None:
    exact, views = tiny(folders, family), images(2, TINY[family].size)
    rough = load_encoder(
        find_checkpoint(f"test/{family}", folders[family]), input_size=exact.input_size, precision="bf16"
    )
    assert cosines(exact.encode(views)[0], rough.encode(views)[0]).mean() > 0.99
