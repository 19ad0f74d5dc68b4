"""What the transformer families share: loading a transformers model from a folder, and running it up to the last block
wanted."""

from __future__ import annotations

import pickle
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from b23d.stages.encoders.interface import Pixels, Resample, Triple
from b23d.stages.encoders.padding import blind_to_padding
from b23d.stages.encoders.weights import CONFIG, PREPROCESSOR, TORCH, Checkpoint, read_json

IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
BATCH = 8
"""Views at a time on a CPU; measured for ViT-S, flat from 4 to 31."""
PIL_RESAMPLING: dict[int, Resample] = {
    0: "nearest-exact",
    1: "bicubic",
    2: "bilinear",
    3: "bicubic",
    4: "bilinear",
    5: "bilinear",
}
"""PIL's number → torch's nearest relative (Lanczos → bicubic; box and Hamming → bilinear)."""


def load_model(model_class: Any, checkpoint: Checkpoint) -> Any:
    """A transformers model in float32, evaluation mode, with every one of its weights from the checkpoint's folder.

    Weights come through safetensors or torch.load(weights_only=True), never by unpickling code.
    Raises ValueError where the checkpoint lacks weights or they have other shapes.
    """
    torch_file = checkpoint.weights[0].name == TORCH
    return complete(
        checkpoint.encoder,
        model_class,
        checkpoint.path,
        local_files_only=True,
        use_safetensors=not torch_file,
        weights_only=True,
        dtype=torch.float32,
    )


def complete(encoder: str, model_class: Any, source: Any, **options: Any) -> Any:
    """`model_class.from_pretrained(source, **options)`, without its chatter, and only if no weight is missing."""
    from transformers.utils import logging

    verbosity, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        model, report = model_class.from_pretrained(source, output_loading_info=True, **options)
    except (RuntimeError, OSError, pickle.UnpicklingError) as error:
        raise ValueError(
            f"encoder {encoder}: expected weights of a {model_class.__name__} in {source}, got files that do not load "
            f"({str(error).strip().splitlines()[-1][:200]}); fetch the checkpoint again"
        ) from error
    finally:
        logging.set_verbosity(verbosity)
        if bars:
            logging.enable_progress_bar()
    if missing := sorted(report["missing_keys"]):
        raise ValueError(
            f"encoder {encoder}: expected all weights of a {model_class.__name__}, got none for {missing[0]} and "
            f"{len(missing) - 1} more in {source}; give the whole checkpoint"
        )
    return model.eval().requires_grad_(False)


def pixels_of(checkpoint: Checkpoint, size: int, mean: Triple, std: Triple, resample: Resample = "bicubic") -> Pixels:
    """How the checkpoint's preprocessor_config.json prepares images, or, where there is none, as the family's constants
    say.

    `mean` and `std` are of levels in 0 … 1. The view is always resized whole: these processors' crops would cut the
    shape.
    """
    given = read_json(path) if (path := checkpoint.path / PREPROCESSOR).is_file() else {}
    if not given:
        return Pixels(size, scaled(mean), scaled(std), resample)
    factor = given.get("rescale_factor", 1 / 255) if given.get("do_rescale", True) else 1.0
    offset = 1.0 if given.get("rescale_offset", False) else 0.0
    normalize = given.get("do_normalize", True)
    mean = tuple(given.get("image_mean", mean)) if normalize else (0.0, 0.0, 0.0)
    std = tuple(given.get("image_std", std)) if normalize else (1.0, 1.0, 1.0)
    if given.get("include_top", str(given.get("image_processor_type")).startswith("EfficientNet")):
        # EfficientNet's processor divides by the deviation a second time (its configured ones are the square roots of
        # ImageNet's).
        std = (std[0] ** 2, std[1] ** 2, std[2] ** 2)
    shifted = (mean[0] + offset, mean[1] + offset, mean[2] + offset)
    return Pixels(
        size, scaled(shifted, factor), scaled(std, factor), PIL_RESAMPLING.get(given.get("resample", -1), resample)
    )


def scaled(values: Triple, factor: float = 1 / 255) -> Triple:
    """Of levels scaled by `factor` → of levels in 0 … 255."""
    return (values[0] / factor, values[1] / factor, values[2] / factor)


def vision_config(checkpoint: Checkpoint) -> dict[str, Any]:
    """config.json, or its `vision_config` where the checkpoint has a text part or a decoder besides."""
    config = read_json(checkpoint.path / CONFIG)
    return config.get("vision_config") or config


class Blocks(nn.Module):
    """A transformers vision model, cut after the last block wanted, and the outputs of the blocks wanted.

    `prefix`: rows before the patches' (class token, registers).
    """

    def __init__(self, model: Any, blocks: tuple[int, ...], prefix: int = 0) -> None:
        super().__init__()
        self.blocks, self.prefix = blocks, prefix
        depth = model.config.num_hidden_layers
        self.layers = next(
            module for module in model.modules() if isinstance(module, nn.ModuleList) and len(module) == depth
        )
        del self.layers[max(blocks) + 1 :]
        self.model = model

    def run(self, pixels: Tensor, kept: Tensor | None = None, **options: Any) -> tuple[list[Tensor], Any]:
        """The outputs (b, prefix + n, channel) of the wanted blocks, in order, and the model's own output (after its
        own final norm and head).

        Patches that are not `kept` are taken out once all are embedded, so that the others keep their positions.
        """
        taken: list[Tensor] = []
        places = None if kept is None else kept.clamp(min=0)

        def keep(_module: nn.Module, _inputs: Any, output: Any) -> None:
            taken.append(output[0] if isinstance(output, tuple) else output)

        def leave_out(_module: nn.Module, _inputs: Any, rows: Tensor) -> Tensor:
            assert places is not None
            views = torch.arange(len(rows), device=rows.device)[:, None]
            before = torch.arange(self.prefix, device=rows.device).expand(len(rows), -1)
            return rows[views, torch.cat([before, places + self.prefix], 1)]

        def leave_out_angles(_module: nn.Module, _inputs: Any, angles: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
            return tuple(one[places][:, None] for one in angles)  # (patch, d) → (b, head, n, d)

        hooks = [self.layers[block].register_forward_hook(keep) for block in self.blocks]
        if kept is not None:
            hooks.append(self.named("embeddings").register_forward_hook(leave_out))
            if rotary := self.find("rope_embeddings"):
                hooks.append(rotary.register_forward_hook(leave_out_angles))
        try:
            with self.blind(kept, pixels.dtype):
                output = self.model(pixels, **options)
        finally:
            for hook in hooks:
                hook.remove()
        return taken, output

    def blind(self, kept: Tensor | None, dtype: torch.dtype) -> AbstractContextManager[None]:
        """To padding, if there is any."""
        if kept is None or not bool((kept < 0).any()):
            return nullcontext()
        return blind_to_padding(self.model, functional.pad(kept < 0, (self.prefix, 0)), dtype)

    def find(self, name: str) -> Any:
        """The model's submodule of that name, at whatever depth this version of transformers has it; None if none."""
        found = (module for path, module in self.model.named_modules() if path.split(".")[-1] == name)
        return next(found, None)

    def named(self, name: str) -> Any:
        """The model's submodule of that name. Raises LookupError where it has none."""
        if (found := self.find(name)) is None:
            raise LookupError(f"{type(self.model).__name__}: expected a submodule {name}, got none; adapt its family")
        return found
