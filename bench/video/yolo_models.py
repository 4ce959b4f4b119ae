"""YOLO-OBB models with random weights that nevertheless see things, exported in every layout that Ultralytics writes.

Needs ultralytics, torch and onnx. No weights are downloaded: a seed makes them, the batch norms are set on the images
given, and the heads are scaled so that a few dozen boxes of many sizes and angles pass a score of 0.25.
"""

from __future__ import annotations

import copy
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["DOTA", "LAYOUTS", "Layout", "export", "random_model"]

DOTA = (
    "plane",
    "ship",
    "storage tank",
    "baseball diamond",
    "tennis court",
    "basketball court",
    "ground track field",
    "harbor",
    "bridge",
    "large vehicle",
    "small vehicle",
    "helicopter",
    "roundabout",
    "soccer ball field",
    "swimming pool",
)
CANDIDATES = 120
"""Anchors of one image that pass a score of 0.25."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """One way to export a model."""

    name: str
    options: Mapping[str, object]
    """For Ultralytics' export."""
    half: bool = False
    """Turned into float16 afterwards, input and output too; its own exporter does so on a GPU only."""
    turned: bool = False
    """The last two axes of the output exchanged afterwards, as some tools do."""
    end_to_end: bool = False
    """Only YOLO26 has it."""


LAYOUTS = (
    Layout(name="raw", options={}),
    Layout(name="raw, any size", options={"dynamic": True}),
    Layout(name="raw, batch 2", options={"batch": 2}),
    Layout(name="raw, float16", options={}, half=True),
    Layout(name="raw, turned", options={}, turned=True),
    Layout(name="nms", options={"nms": True, "conf": 0.25, "iou": 0.45}),
    Layout(name="nms, any size", options={"nms": True, "conf": 0.25, "iou": 0.45, "dynamic": True, "batch": 2}),
    Layout(name="nms, batch 2", options={"nms": True, "conf": 0.25, "iou": 0.45, "batch": 2}),
    Layout(name="nms, float16", options={"nms": True, "conf": 0.25, "iou": 0.45}, half=True),
    Layout(name="end to end", options={"nms": False}, end_to_end=True),
    Layout(name="end to end, any size", options={"nms": False, "dynamic": True}, end_to_end=True),
    Layout(name="end to end, batch 2", options={"nms": False, "batch": 2}, end_to_end=True),
    Layout(name="end to end, float16", options={"nms": False}, half=True, end_to_end=True),
)


def random_model(family: str, names: Sequence[str], images: Sequence[NDArray[np.uint8]], seed: int) -> Any:  # noqa: ANN401
    """A model of Ultralytics' own class.

    Args:
        family: name of a configuration that the package holds, such as ``yolo11n-obb``.
        names: of its classes.
        images: (640, 640, 3) BGR, to set it up on.
        seed: of the weights.
    """
    torch, ultralytics = importlib.import_module("torch"), importlib.import_module("ultralytics")
    torch.manual_seed(seed)
    model = ultralytics.YOLO(f"{family}.yaml", task="obb")
    plain = model.model
    model.model = type(plain)(f"{family}.yaml", nc=len(names), verbose=False)
    model.model.args, model.model.task, model.model.names = plain.args, plain.task, dict(enumerate(names))
    batch = torch.from_numpy(np.stack(images)[..., ::-1].transpose(0, 3, 1, 2).astype(np.float32) / 255.0)
    with torch.no_grad():
        _set_norms(model.model, batch)
        head = model.model.model[-1]
        for prefix in ("", "one2one_"):
            if getattr(head, f"{prefix}cv3", None) is not None:
                _set_head(model.model, head, prefix, batch)
    return model


def export(model: Any, layout: Layout, path: Path, side: int) -> Path:  # noqa: ANN401
    """Write a model as ONNX.

    Args:
        model: from ``random_model``.
        layout: how.
        path: the file.
        side: of the canvas, px.
    """
    copy.deepcopy(model).export(format="onnx", imgsz=side, verbose=False, device="cpu", **layout.options)
    Path(model.cfg).with_suffix(".onnx").replace(path)
    onnx = importlib.import_module("onnx")
    graph = onnx.load(path)
    if layout.half:
        float16 = importlib.import_module("onnxruntime.transformers.float16")
        graph = float16.convert_float_to_float16(graph, keep_io_types=False)
    if layout.turned:
        _turn(onnx, graph)
    onnx.save(graph, path)
    return path


def _set_norms(network: Any, batch: Any) -> None:  # noqa: ANN401
    """Batch norms that leave what flows through them with a mean of 0 and a deviation of 1."""
    norms = [m for m in network.modules() if type(m).__name__ == "BatchNorm2d"]
    before = [m.momentum for m in norms]
    for m in norms:
        m.reset_running_stats()
        m.momentum = None
    network.train()
    network(batch)
    network.eval()
    for m, momentum in zip(norms, before, strict=True):
        m.momentum = momentum


def _set_head(network: Any, head: Any, prefix: str, batch: Any) -> None:  # noqa: ANN401
    """Scale the last convolutions: logits of a few boxes above 0.25, sides of one to eight cells, any angle."""
    last = {name: [level[-1] for level in getattr(head, prefix + name)] for name in ("cv2", "cv3", "cv4")}
    plain = head.reg_max == 1
    _spread(network, batch, last["cv3"], 0.0, 0.6)
    # a plain head gives distances as they are: far enough from zero that no box is turned inside out
    _spread(network, batch, last["cv2"], 2.5 if plain else 0.0, 0.2 if plain else 2.0)
    _spread(network, batch, last["cv4"], 0.0, 0.7 if plain else 1.5)
    if not plain:
        for layer in last["cv2"]:
            # of the 16 distances of a side, the near ones are likelier
            layer.bias -= 0.5 * (layer.bias.new_tensor(range(len(layer.bias))) % head.reg_max)
    logits = np.concatenate([o.amax(1).reshape(-1).numpy() for o in _outputs(network, batch, last["cv3"])])
    limit = np.partition(logits, -CANDIDATES * len(batch))[-CANDIDATES * len(batch)]
    for layer in last["cv3"]:
        layer.bias += float(np.log(0.25 / 0.75) - limit)


def _spread(network: Any, batch: Any, layers: Sequence[Any], mean: float, deviation: float) -> None:  # noqa: ANN401
    """Every channel of the layers' outputs with this mean and deviation over the images."""
    for layer, out in zip(layers, _outputs(network, batch, layers), strict=True):
        gain = deviation / out.std((0, 2, 3)).clamp(min=1e-6)
        layer.weight *= gain[:, None, None, None]
        layer.bias.copy_((layer.bias - out.mean((0, 2, 3))) * gain + mean)


def _outputs(network: Any, batch: Any, layers: Sequence[Any]) -> list[Any]:  # noqa: ANN401
    kept: dict[int, Any] = {}
    hooks = [m.register_forward_hook(lambda _m, _i, out, k=k: kept.__setitem__(k, out)) for k, m in enumerate(layers)]
    network(batch)
    for hook in hooks:
        hook.remove()
    return [kept[k] for k in range(len(layers))]


def _turn(onnx: Any, graph: Any) -> None:  # noqa: ANN401
    """Exchange the last two axes of the output."""
    out = graph.graph.output[0]
    plain = out.name + "_plain"
    for node in graph.graph.node:
        node.output[:] = [plain if name == out.name else name for name in node.output]
    graph.graph.node.append(onnx.helper.make_node("Transpose", [plain], [out.name], perm=[0, 2, 1]))
    rows, columns = out.type.tensor_type.shape.dim[1], out.type.tensor_type.shape.dim[2]
    rows.dim_value, columns.dim_value = columns.dim_value, rows.dim_value
