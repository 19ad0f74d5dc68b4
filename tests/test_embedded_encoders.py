"""The encoders whose weights come with a package: that they are the networks they say they are."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from b23d.stages.encoders.names import SALIENCY
from b23d.stages.encoders.weights import find_checkpoint
from tests.tiny_encoders import cosines, embedded, images, prepared, scene


def test_bf16_is_near() -> None:
    view = scene()
    exact, rough = (
        embedded("saliency-vit-s14", precision=precision).encode(view)[0].astype(np.float64)
        for precision in ("fp32", "bf16")
    )
    cosine = cosines(exact, rough)
    assert cosine.min() > 0.998 and cosine.mean() > 0.9995


def test_lite0_knows_what_it_was_trained_on() -> None:
    from b23d.stages.encoders.efficientnet_lite0 import PIXELS, load_network

    network = load_network(find_checkpoint("efficientnet-lite0").path)
    with torch.inference_mode():
        x = prepared(PIXELS, scene())
        logits = network(x)
        fused = network.fuse()(x)
    assert logits.argmax(1).tolist() == [549, 722]  # ImageNet: envelope, ping-pong ball
    assert float(logits.softmax(1)[0, 549]) > 0.6
    torch.testing.assert_close(fused, logits, atol=1e-3, rtol=1e-3)


def test_lite0_pads_as_tensorflow() -> None:
    """ "SAME": the output has ceil(n / stride) places, and the odd pixel of padding is at the end."""
    from b23d.stages.encoders.efficientnet_lite0 import SameConv2d

    for side, stride, start in ((8, 2, 0), (7, 2, 1), (8, 1, 1)):
        convolution = SameConv2d(1, 1, 3, stride, bias=False)
        with torch.no_grad():
            convolution.weight.zero_()[0, 0, 1, 1] = 1
            ramp = torch.arange(float(side)).expand(1, 1, side, side)
            assert convolution(ramp)[0, 0, 0].tolist() == [
                float(i * stride - start + 1) for i in range(-(-side // stride))
            ]


def test_saliency_vit_is_the_onnx_graph() -> None:
    """onnx's own evaluator, node by node, up to the block that is taken."""
    onnx = pytest.importorskip("onnx")
    from onnx.reference import ReferenceEvaluator

    encoder = embedded("saliency-vit-s14", precision="fp32")
    assert (encoder.grid, encoder.channels, encoder.input_size, encoder.class_token) == ((16, 16), 384, 224, True)
    graph = onnx.load(str(find_checkpoint("saliency-vit-s14").path)).graph
    output = f"/backbone/encoder/layer.{SALIENCY.block}/Add_1_output_0"
    needed, nodes = {output}, []
    for node in reversed(graph.node):
        if needed & set(node.output):
            needed |= set(node.input)
            nodes.insert(0, node)
    floats = onnx.TensorProto.FLOAT
    blocks = onnx.helper.make_graph(
        nodes,
        "the first blocks",
        [onnx.helper.make_tensor_value_info("input_image", floats, None)],
        [onnx.helper.make_tensor_value_info(output, floats, None)],
        [tensor for tensor in graph.initializer if tensor.name in needed],
    )
    view = images(1, 224)
    x = prepared(encoder.backbone.pixels, view)
    (expected,) = ReferenceEvaluator(
        onnx.helper.make_model(blocks, opset_imports=[onnx.helper.make_opsetid("", 14)])
    ).run(None, {"input_image": x.contiguous().numpy()})
    with torch.inference_mode():
        patches, first = encoder.backbone.network(x)
    np.testing.assert_allclose(first.numpy(), expected[:, 0], atol=5e-5)
    np.testing.assert_allclose(patches.numpy(), expected[:, 1:], atol=5e-5)
