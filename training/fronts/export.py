"""Write a ResNet-18 as ONNX with 8-bit weights, as ``vision.detect.front`` reads it; and read the weights back.

A kernel is kept as int8 with a scale for each output channel and is made float when the file is loaded:
W ≈ q · s, s = max |W| / 127. Normalisation layers stay apart and every weight keeps its torchvision name, so the file
is a checkpoint as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from training.fronts.vehicles import MEAN, STD

OPSET = 17
"""ONNX operator set of the file; ONNX Runtime reads it from 1.12 on."""
STAGES = 4
"""Stages of two residual blocks in a ResNet-18."""
SCALE = ".scale"
"""Suffix of the tensor that int8 weights are multiplied by."""
Weights = Mapping[str, NDArray[np.float32]]


class _Int8Graph:
    """Nodes and weights as they are added; every method returns the name of its result."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights
        self.nodes: list[onnx.NodeProto] = []
        self.tensors: list[onnx.TensorProto] = []

    def node(self, kind: str, *inputs: str, **attributes: object) -> str:
        name = f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def tensor(self, name: str, values: NDArray[np.generic]) -> str:
        self.tensors.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def kernel(self, name: str) -> str:
        weight = self.weights[name]
        scale = np.maximum(np.abs(weight).reshape(len(weight), -1).max(axis=1), 1e-12) / 127.0
        scale = scale.reshape(-1, *[1] * (weight.ndim - 1)).astype(np.float32)
        small = self.tensor(name, np.rint(weight / scale).astype(np.int8))
        return self.node("Mul", self.node("Cast", small, to=TensorProto.FLOAT), self.tensor(name + SCALE, scale))

    def conv_norm(self, x: str, conv: str, norm: str, stride: int) -> str:
        side = self.weights[conv + ".weight"].shape[-1]
        y = self.node("Conv", x, self.kernel(conv + ".weight"), strides=[stride] * 2, pads=[side // 2] * 4)
        parts = [
            self.tensor(f"{norm}.{part}", self.weights[f"{norm}.{part}"])
            for part in ("weight", "bias", "running_mean", "running_var")
        ]
        return self.node("BatchNormalization", y, *parts, epsilon=1e-5)

    def block(self, x: str, name: str, stride: int) -> str:
        y = self.node("Relu", self.conv_norm(x, f"{name}.conv1", f"{name}.bn1", stride))
        y = self.conv_norm(y, f"{name}.conv2", f"{name}.bn2", 1)
        if stride > 1:
            x = self.conv_norm(x, f"{name}.downsample.0", f"{name}.downsample.1", stride)
        return self.node("Relu", self.node("Add", x, y))


def to_onnx(weights: Weights, side: int, metadata: Mapping[str, str]) -> onnx.ModelProto:
    """A classifier as a model of its own.

    Args:
        weights: of a trained ResNet-18, by torchvision's names.
        side: of its crops, px.
        metadata: as ``vision.detect.front`` reads it.

    Returns:
        A model: ``crops`` (N, 3, side, side) float32 normalised RGB → ``logits`` (N, classes) float32.
    """
    g = _Int8Graph(weights)
    x = g.node("Relu", g.conv_norm("crops", "conv1", "bn1", 2))
    x = g.node("MaxPool", x, kernel_shape=[3, 3], strides=[2, 2], pads=[1] * 4)
    for stage in range(1, STAGES + 1):
        x = g.block(x, f"layer{stage}.0", 1 if stage == 1 else 2)
        x = g.block(x, f"layer{stage}.1", 1)
    flat = g.node("Flatten", g.node("GlobalAveragePool", x))
    last = (g.tensor(name, weights[name]) for name in ("fc.weight", "fc.bias"))
    g.nodes.append(helper.make_node("Gemm", [flat, *last], ["logits"], transB=1))
    crops = helper.make_tensor_value_info("crops", TensorProto.FLOAT, ["n", 3, side, side])
    out = helper.make_tensor_value_info("logits", TensorProto.FLOAT, ["n", len(weights["fc.bias"])])
    graph = helper.make_graph(g.nodes, "rollcall-front", [crops], [out], g.tensors)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8, producer_name="rollcall"
    )
    helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model


def metadata(seed: int, classes: int, margin: float, trained_on: str) -> dict[str, str]:
    """Metadata that ``vision.detect.front`` needs of a classifier, and its origin."""
    return {
        "rollcall_front": "1",
        "front_deg": " ".join(str(360 * k // classes) for k in range(classes)),
        "margin": str(margin),
        "mean": " ".join(f"{value:g}" for value in MEAN),
        "std": " ".join(f"{value:g}" for value in STD),
        "seed": str(seed),
        "trained_on": trained_on,
    }


def read_weights(path: Path) -> dict[str, NDArray[np.float32]]:
    """Weights of a file that ``to_onnx`` wrote, by torchvision's names, 8-bit kernels made float again."""
    tensors = {t.name: numpy_helper.to_array(t) for t in onnx.load(str(path)).graph.initializer}
    return {
        name: values.astype(np.float32) * tensors.get(name + SCALE, np.float32(1.0))
        for name, values in tensors.items()
        if not name.endswith(SCALE)
    }
