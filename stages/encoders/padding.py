"""Attention that sees no padding, in any transformers model: views with unlike numbers of patches go through together.

By transformers' own registry of attention functions, since not every release lets every model be given a mask.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import torch
from torch import Tensor, nn
from transformers import AttentionInterface, AttentionMaskInterface
from transformers.integrations.sdpa_attention import sdpa_attention_forward
from transformers.masking_utils import sdpa_mask

NAME = "b23d_blind_to_padding"
_SCORES: ContextVar[Tensor] = ContextVar("scores of the padding")


@contextmanager
def blind_to_padding(model: Any, padding: Tensor, dtype: torch.dtype) -> Iterator[None]:
    """Within, no row of `model` attends to those that are `padding`, bool (b, row); nor does a pooling head.

    model: a transformers vision model, which attends by torch's scaled dot product.
    """
    scores = torch.zeros(padding.shape, dtype=dtype, device=padding.device).masked_fill_(padding, -torch.inf)

    def in_head(_head: nn.Module, given: tuple[Any, ...], named: dict[str, Any]) -> tuple[Any, Any]:
        return given, named | {"key_padding_mask": scores}

    heads = [module for module in model.modules() if isinstance(module, nn.MultiheadAttention)]
    hooks = [head.register_forward_pre_hook(in_head, with_kwargs=True) for head in heads]
    before = model.config._attn_implementation
    token = _SCORES.set(scores[:, None, None])  # b, head, query, key
    try:
        model.set_attn_implementation(NAME)
        yield
    finally:
        model.set_attn_implementation(before)
        _SCORES.reset(token)
        for hook in hooks:
            hook.remove()


def _attend(
    module: nn.Module, query: Tensor, key: Tensor, value: Tensor, _mask: Tensor | None, **options: Any
) -> tuple[Tensor, None]:
    return sdpa_attention_forward(module, query, key, value, _SCORES.get(), **options)


AttentionInterface.register(NAME, _attend)
AttentionMaskInterface.register(NAME, sdpa_mask)
