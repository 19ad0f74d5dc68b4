"""A new encoder family is one file and one line: tried with a toy that the project does not know."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from b23d.stages import encoders
from b23d.stages.encoders import names
from b23d.stages.encoders.names import FAMILIES, Family
from b23d.stages.extract import ExtractParams, extract, weights_digest
from tests.test_extract import views

TOY = """
from torch import nn
from safetensors.torch import load_file
from b23d.stages.encoders.interface import Backbone, Pixels, tokens_of

class Means(nn.Module):
    def __init__(self, gain):
        super().__init__()
        self.gain = nn.Parameter(gain, requires_grad=False)

    def forward(self, pixels, kept=None):
        return tokens_of(nn.functional.avg_pool2d(pixels, 16) * self.gain), None

def build(checkpoint, settings):
    network = Means(load_file(checkpoint.weights[0])["gain"])
    return Backbone(network, Pixels(64, (0, 0, 0), (1, 1, 1)), (4, 4), 3, False, False, 4, whole=True)
"""


def test_a_family_is_one_file_and_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "toy.py").write_text(TOY)
    monkeypatch.setattr(encoders, "__path__", [*encoders.__path__, str(tmp_path)])
    monkeypatch.setattr(names, "FAMILIES", (*FAMILIES, Family("toy", ("toy",), {"toy-means": "someone/toy-means"})))
    folder = tmp_path / "weights"
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"model_type": "toy"}))
    save_file({"gain": torch.tensor(0.5)}, folder / "model.safetensors")

    params = ExtractParams(encoder="someone/toy-means", weights=folder, tokens="all")
    assert params.encoder == "toy-means" and "toy-means" in names.short_names()
    assert set(weights_digest(params)) == {"weights", "config"}
    shown = views(2, 64)
    found = extract(shown, params)
    expected = shown.images.reshape(2, 4, 16, 4, 16, 3).mean(axis=(2, 4)) / 2
    np.testing.assert_allclose(found.grid(), expected, rtol=1e-3)
    unnamed = extract(shown, ExtractParams(encoder="someone/else", weights=folder, tokens="all"))
    np.testing.assert_array_equal(unnamed.tokens, found.tokens)


def test_every_family_has_its_file_and_every_name_and_type_one_family() -> None:
    for family in FAMILIES:
        assert (Path(encoders.__file__).parent / f"{family.module}.py").is_file()
    known = names.short_names() + [hub for family in FAMILIES for hub in family.hub.values()]
    types = [model_type for family in FAMILIES for model_type in family.model_type]
    assert len(set(known)) == len(known) and len(set(types)) == len(types)
