"""A model file between two: of a run that began with another's weights, part of the way back is often better on both.

``python -m training.blend OLD.onnx NEW.onnx --share 0.75 --score 0.558 --out vision/models/rollcall-obb-s.onnx``

What the new one learnt beside what the old one knew: M. Wortsman et al., "Robust fine-tuning of zero-shot models",
arXiv:2109.01903.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper

from training.export import SCORE, score_shift
from vision.errors import ModelError


def blend(old: Path, new: Path, share: float, score: float = SCORE) -> onnx.ModelProto:
    """The model (1 − share) old + share new, weight by weight, with the metadata of the new one.

    Args:
        share: of the new one, 0 to 1.
        score: that the model returns as ``SCORE``.

    Raises:
        ModelError: they are not of one network.
    """
    first, model = onnx.load(str(old)), onnx.load(str(new))
    layouts = [[(w.name, tuple(w.dims)) for w in m.graph.initializer] for m in (first, model)]
    if layouts[0] != layouts[1]:
        raise ModelError(f"{old} and {new} are of different networks; give a file and one that was trained from it")
    verdict = [node for node in model.graph.node if node.op_type == "Conv"][-1].input[2]
    for before, weight in zip(first.graph.initializer, model.graph.initializer, strict=True):
        a, b = numpy_helper.to_array(before), numpy_helper.to_array(weight)
        if not np.issubdtype(b.dtype, np.floating):
            continue
        mean = (1.0 - share) * a.astype(np.float64) + share * b
        if weight.name == verdict:
            mean = mean + score_shift(score)
        weight.CopyFrom(numpy_helper.from_array(mean.astype(b.dtype), weight.name))
    return model


def main() -> None:
    """Blend from the command line."""
    parser = argparse.ArgumentParser(description="Write a model file between two.")
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--share", type=float, default=0.5, help="of the new one, 0 to 1")
    parser.add_argument("--score", type=float, default=SCORE, help="score that the file returns as 0.3")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    if not 0.0 <= args.share <= 1.0:
        parser.error("--share is between 0 and 1")
    onnx.save(blend(args.old, args.new, args.share, args.score), str(args.out))


if __name__ == "__main__":
    main()
