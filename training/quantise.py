"""A model file whose middle layers compute with 8-bit numbers: twice as fast, and as good where that is measured.

``python -m training.quantise vision/models/rollcall-obb-s.onnx --pictures .train/pool --out int8.onnx``

The range of each layer's numbers is taken from rendered images. The first layer and those of the map and the judge stay
as they are: their errors would be errors of boxes and scores.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

KEPT_FIRST, KEPT_LAST = 1, 6
"""Convolutions that stay as they are, at either end of the file."""
MAX_IMAGES = 60


class _Images(CalibrationDataReader):  # type: ignore[misc]  # onnxruntime is not typed
    """The images of rendered shards, one by one."""

    def __init__(self, folder: Path) -> None:
        self._images = self._read(folder)

    @staticmethod
    def _read(folder: Path) -> Iterator[NDArray[np.uint8]]:
        for path in sorted(folder.glob("crops_*.npz")):
            with np.load(path) as shard:
                yield from shard["images"][:MAX_IMAGES]

    def get_next(self) -> dict[str, NDArray[np.uint8]] | None:
        image = next(self._images, None)
        return None if image is None else {"image": image[None]}


def quantise(model: Path, pictures: Path, out: Path) -> None:
    """Write the model with 8-bit arithmetic.

    Args:
        pictures: folder of rendered shards, by whose images the ranges are found.
        out: file to write.
    """
    graph = onnx.load(str(model))
    for number, node in enumerate(graph.graph.node):
        node.name = f"n{number}"
    layers = [node.name for node in graph.graph.node if node.op_type == "Conv"]
    with tempfile.TemporaryDirectory() as scratch:
        named = Path(scratch) / "named.onnx"
        onnx.save(graph, str(named))
        quantize_static(
            str(named),
            str(out),
            _Images(pictures),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            op_types_to_quantize=["Conv", "Relu", "Add"],
            nodes_to_exclude=[*layers[:KEPT_FIRST], *layers[-KEPT_LAST:]],
        )
    written = onnx.load(str(out))
    onnx.helper.set_model_props(written, {note.key: note.value for note in graph.metadata_props})
    onnx.save(written, str(out))


def main() -> None:
    """Quantise from the command line."""
    parser = argparse.ArgumentParser(description="Write a model file with 8-bit arithmetic.")
    parser.add_argument("model", type=Path)
    parser.add_argument("--pictures", type=Path, required=True, help="folder of rendered shards")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    quantise(args.model, args.pictures, args.out)


if __name__ == "__main__":
    main()
