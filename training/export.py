"""Write a trained network as ONNX, batch norm folded, peaks picked: what ``vision.detect.decode_heatmap`` reads.

``python -m training.export --checkpoint .train/checkpoint.pt --out vision/models/rollcall-obb-s.onnx``

The graph is written node by node: it is small, and no exporter's version changes it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from training.net import JUDGED, STRIDE, ConvNorm, Grow, Judge, Net, Residual
from vision.detect.onnx_model import open_session
from vision.errors import ModelError

OPSET = 17
"""ONNX operator set of the file; ONNX Runtime reads it from 1.12 on."""
NOMINAL_LENGTH_PX = 29.0
"""Length of a 2.5 m vehicle at which the network is best; the detector scales images to it."""
SCORE, PRECISION = 0.3, 0.85
"""Scores of a file that is written are shifted so that from here on this share of detections is right on held-out
images: a false alarm costs an operator more than a vehicle found a frame later."""


class _FloatGraph:
    """Nodes and weights as they are added; every method returns the name of its result."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []
        self.layers: list[tuple[ConvNorm | nn.Conv2d, float]] = []
        """Origin of each Conv node in order, what it was made from, and the factor of its kernel."""

    def node(self, kind: str, *inputs: str, **attributes: object) -> str:
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def weight(self, values: NDArray[np.generic]) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def conv(self, x: str, kernel: NDArray[np.float32], bias: NDArray[np.float32], stride: int) -> str:
        pad = kernel.shape[-1] // 2
        return self.node(
            "Conv",
            x,
            self.weight(kernel),
            self.weight(bias),
            strides=[stride] * 2,
            pads=[pad] * 4,
            kernel_shape=list(kernel.shape[2:]),
        )

    def conv_norm(self, x: str, module: ConvNorm, gain: float = 1.0) -> str:
        kernel, bias = _folded(module)
        self.layers.append((module, gain))
        y = self.conv(x, kernel * np.float32(gain), bias, int(module.conv.stride[0]))
        return self.node("Relu", y) if module.relu else y

    def head(self, x: str, module: nn.Conv2d) -> str:
        self.layers.append((module, 1.0))
        return self.conv(x, _numpy(module.weight), _numpy(module.bias), 1)

    def residual(self, x: str, module: Residual) -> str:
        y = self.conv_norm(self.conv_norm(x, module.first), module.second)
        return self.node("Relu", self.node("Add", x, y))

    def stage(self, x: str, blocks: nn.Sequential) -> str:
        for block in blocks:
            x = self.residual(x, block) if isinstance(block, Residual) else self.conv_norm(x, block)
        return x

    def grow(self, x: str, module: Grow) -> str:
        return self.node("DepthToSpace", self.conv_norm(x, module.spread), blocksize=2, mode="CRD")

    def part(self, x: str, first: int, last: int) -> str:
        ends = [self.weight(np.array([v], np.int64)) for v in (first, last, 1)]
        return self.node("Slice", x, *ends)


def to_onnx(net: Net, version: str, nominal_length_px: float = NOMINAL_LENGTH_PX) -> onnx.ModelProto:
    """The network as a model of its own.

    Args:
        nominal_length_px: length of a nominal vehicle (2.5 m) at which the network is best.

    Returns:
        A model: ``image`` (1, H, W, 3) uint8 BGR → ``map`` (1, 9, H / 4, W / 4) float32, channel 0 the score where it
        is the greatest of its 3 × 3 neighbours, else 0; the other channels as in ``net``.
    """
    return _model(_graph(net), version, nominal_length_px)


def _graph(net: Net) -> _FloatGraph:
    net.eval()
    g = _FloatGraph()
    image = g.node("Transpose", g.node("Cast", "image", to=TensorProto.FLOAT), perm=[0, 3, 1, 2])
    stem_first, stem_second = net.stem
    # the stem's kernel takes 0..255 in place of 0..1
    quarter = g.conv_norm(g.conv_norm(image, stem_first, gain=1.0 / 255.0), stem_second)
    eighth = g.stage(quarter, net.middle)
    sixteenth = g.stage(eighth, net.deep)
    sixteenth = g.node("Relu", g.node("Add", sixteenth, g.grow(g.stage(sixteenth, net.wide), net.wide_side)))
    eighth = g.stage(g.node("Relu", g.node("Add", eighth, g.grow(sixteenth, net.deep_side))), net.join)
    finest = g.node("Add", g.conv_norm(quarter, net.stem_side), g.grow(eighth, net.join_side))
    last = g.stage(g.node("Relu", finest), net.last)
    raw = g.head(last, net.head)
    logit = g.part(raw, 0, 1)
    centre = g.node("Sigmoid", logit)
    highest = g.node("MaxPool", centre, kernel_shape=[3, 3], pads=[1, 1, 1, 1], strides=[1, 1])
    judged = g.node("GreaterOrEqual", centre, g.weight(np.array(JUDGED, np.float32)))
    peak = g.node("Cast", g.node("And", g.node("Equal", centre, highest), judged), to=TensorProto.FLOAT)
    score = g.node("Sigmoid", g.node("Add", logit, _judge(g, net.judge, sixteenth, eighth, last)))
    g.nodes.append(helper.make_node("Concat", [g.node("Mul", score, peak), g.part(raw, 1, 99)], ["map"], axis=1))
    return g


def _judge(g: _FloatGraph, judge: Judge, sixteenth: str, eighth: str, quarter: str) -> str:
    eighth = g.node("Relu", g.node("Add", g.grow(sixteenth, judge.deep_side), g.conv_norm(eighth, judge.join_side)))
    quarter = g.node("Relu", g.node("Add", g.grow(eighth, judge.middle_side), g.conv_norm(quarter, judge.last_side)))
    return g.head(quarter, judge.verdict)


def export(checkpoint: Path, out: Path, version: str, score: float = SCORE) -> None:
    """Turn a training checkpoint's averaged weights into a model file.

    Args:
        checkpoint: of ``training.train``.
        score: from which on ``PRECISION`` of the detections are right on held-out images; the file stores it as
            ``SCORE``.
    """
    net = Net()
    net.load_state_dict(torch.load(checkpoint, map_location="cpu", weights_only=True)["average"])
    with torch.no_grad():
        net.judge.verdict.bias[0] += score_shift(score)
    out.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(to_onnx(net, version), str(out))


def score_shift(score: float) -> float:
    """Bias that is added to the logits of scores so that ``score`` becomes ``SCORE``: logit SCORE − logit score."""
    return math.log(SCORE / (1.0 - SCORE)) - math.log(score / (1.0 - score))


def read_weights(net: Net, path: Path) -> None:
    """Give a network the weights of a model file that ``to_onnx`` wrote.

    The file has no batch norms, they are folded into kernels and biases: the network's become the identity but for
    their bias, as k = k', μ = 0, σ = γ = 1, β = b'. ``restore_statistics`` makes them fit for training.

    Args:
        net: is changed.

    Raises:
        ModelError: no such file, not one of Rollcall's, or of another network.
    """
    open_session(path, ("CPUExecutionProvider",), 1)  # says what is wrong with a file that is no model
    model = onnx.load(str(path))
    graph = _graph(net)
    if _layout(graph.nodes, graph.weights) != _layout(model.graph.node, model.graph.initializer):
        raise ModelError(f"{path}: is of another network than this version trains; begin with the bundled model")
    weights = {weight.name: numpy_helper.to_array(weight) for weight in model.graph.initializer}
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    with torch.no_grad():
        for (module, gain), node in zip(graph.layers, convolutions, strict=True):
            kernel, bias = (torch.from_numpy(weights[name].copy()) for name in node.input[1:3])
            if isinstance(module, ConvNorm):
                module.conv.weight.copy_(kernel / gain)
                module.norm.bias.copy_(bias)
                module.norm.weight.fill_(1.0)
                module.norm.running_mean.zero_()
                module.norm.running_var.fill_(1.0 - module.norm.eps)
            else:
                module.weight.copy_(kernel)
                module.bias.copy_(bias)


def _layout(nodes: Sequence[onnx.NodeProto], weights: Sequence[onnx.TensorProto]) -> list[tuple[object, ...]]:
    """Kinds of the nodes in order, and the shapes of their weights."""
    shapes = {weight.name: tuple(weight.dims) for weight in weights}
    return [(node.op_type, *(shapes.get(name) for name in node.input)) for node in nodes]


def restore_statistics(net: Net, images: torch.Tensor) -> None:
    """Set the statistics of batch norms to those of some images and keep what the network computes.

    With mean μ and variance σ² of what a norm is given, γ' = γ σ / σ_old and β' = β + γ (μ − μ_old) / σ_old.

    Args:
        net: is changed.
        images: (B, 3, H, W) as in training.
    """

    def restore(norm: nn.BatchNorm2d, given: tuple[torch.Tensor]) -> None:
        mean, variance = given[0].mean(dim=(0, 2, 3)), given[0].var(dim=(0, 2, 3))
        slope = norm.weight / (norm.running_var + norm.eps).sqrt()
        norm.bias += slope * (mean - norm.running_mean)
        norm.weight.copy_(slope * (variance + norm.eps).sqrt())
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)

    norms = [module for module in net.modules() if isinstance(module, nn.BatchNorm2d)]
    hooks = [norm.register_forward_pre_hook(restore) for norm in norms]
    net.eval()
    with torch.no_grad():
        net(images)
    for hook in hooks:
        hook.remove()


def _model(g: _FloatGraph, version: str, nominal_length_px: float) -> onnx.ModelProto:
    image = helper.make_tensor_value_info("image", TensorProto.UINT8, [1, "height", "width", 3])
    out = helper.make_tensor_value_info("map", TensorProto.FLOAT, [1, 9, "rows", "columns"])
    graph = helper.make_graph(g.nodes, "rollcall-obb", [image], [out], g.weights)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8, producer_name="rollcall"
    )
    metadata = {
        "rollcall": version,
        "stride": str(STRIDE),
        "nominal_length_px": str(nominal_length_px),
        "nominal_length_m": "2.5",
    }
    helper.set_model_props(model, metadata)
    onnx.checker.check_model(model, full_check=True)
    return model


def _folded(module: ConvNorm) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Kernel and bias with the batch norm in them: k' = k γ/σ, b' = β − μ γ/σ."""
    norm = module.norm
    factor = _numpy(norm.weight) / np.sqrt(_numpy(norm.running_var) + np.float32(norm.eps))
    return _numpy(module.conv.weight) * factor[:, None, None, None], _numpy(norm.bias) - _numpy(
        norm.running_mean
    ) * factor


def _numpy(tensor: torch.Tensor | None) -> NDArray[np.float32]:
    if tensor is None:
        raise ValueError("a trained layer without weights cannot be exported")
    return np.asarray(tensor.detach().cpu().numpy(), dtype=np.float32)


def main() -> None:
    """Export from the command line."""
    parser = argparse.ArgumentParser(description="Write a trained detector as ONNX.")
    parser.add_argument("--checkpoint", type=Path, default=Path(".train/checkpoint.pt"))
    parser.add_argument("--out", type=Path, default=Path("vision/models/rollcall-obb-s.onnx"))
    parser.add_argument("--version", default="7")
    parser.add_argument("--score", type=float, default=SCORE, help="score that the file returns as 0.3")
    args = parser.parse_args()
    export(args.checkpoint, args.out, args.version, args.score)


if __name__ == "__main__":
    main()
