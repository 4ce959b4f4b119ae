"""The metadata of an ONNX file that is a classifier of fronts.

One input [N, 3, S, S] float32 or float16, RGB normalised; one output [N, classes], logits: what any framework exports
for an image classifier. Its metadata has the rest, with these defaults:

    front_deg   where the front of each class is, degrees clockwise on the crop from +x, or ``nan`` for a class that
                has no front; "0 180" of two classes, "0 90 180 270" of four; other counts must give it
    margin      how much more than the box is on the crop, a share of its sides: "0"
    mean, std   of the normalisation, of values in 0..1: ImageNet's
    size        side S where the input's is open: "224"
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnxruntime as ort
from numpy.typing import DTypeLike, NDArray

from vision.detect.onnx_model import described, metadata
from vision.errors import ModelError

FRONTS_DEG = {2: (0.0, 180.0), 4: (0.0, 90.0, 180.0, 270.0)}
"""Default directions of the front, from the crop's +x, by number of classes."""
ACCEPTED = (
    "accepted are image classifiers (one input [N, 3, S, S] float32 or float16 → one output [N, classes] of logits; "
    "metadata 'front_deg' unless there are 2 or 4 classes)"
)
MOST_BATCH, MOST_SIDE, MOST_CLASSES = 64, 1024, 360
"""A run is 800 MB at the most; more classes than degrees make no sense."""
_DTYPES: dict[str, DTypeLike] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_DEFAULTS = {"margin": "0", "mean": "0.485 0.456 0.406", "std": "0.229 0.224 0.225", "size": "224"}
_COUNTS = {"margin": 1, "mean": 3, "std": 3, "size": 1}
"""Numbers in each entry of the metadata."""
_RANGES = {"margin": (0.0, 4.0), "mean": (-1e3, 1e3), "std": (1e-6, 1e3), "size": (8.0, MOST_SIDE)}
"""Least and largest value of each."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contract:
    """How a classifier's crops are made and what its classes mean."""

    name: str
    """Name of the input."""
    dtype: DTypeLike
    batch: int | None
    """Crops in every run; None: any number."""
    side: int
    """Side of a crop, px."""
    margin: float
    mean: NDArray[np.float32]
    """(3,) RGB."""
    std: NDArray[np.float32]
    """(3,) RGB."""
    front: NDArray[np.float64]
    """(classes,) rad clockwise on the crop from +x, NaN of a class without front."""


def read_contract(session: ort.InferenceSession, where: str) -> Contract:
    """Read a classifier's contract from its file.

    Raises:
        ModelError: its inputs or outputs are not of a classifier, or its metadata make no sense.
    """
    image, classes = _ends(session, where)
    notes = metadata(session)
    front = _fronts(notes, classes, where)
    values = {key: _in_range(key, _numbers(notes, key, text, where), where) for key, text in _DEFAULTS.items()}
    batch, _, side, _ = image.shape
    fixed = batch if isinstance(batch, int) else None
    side = side if isinstance(side, int) else int(values["size"][0])
    if not (1 <= (fixed or 1) <= MOST_BATCH and 8 <= side <= MOST_SIDE and len(front) <= MOST_CLASSES):
        raise ModelError(
            f"{where}: it takes {fixed or 'any number of'} crops of {side} × {side} px and has {len(front)} classes; "
            f"at most {MOST_BATCH} crops of {MOST_SIDE} px and {MOST_CLASSES} classes are accepted"
        )
    return Contract(
        name=image.name,
        dtype=_DTYPES[image.type],
        batch=fixed,
        side=side,
        margin=values["margin"][0],
        mean=np.array(values["mean"], np.float32),
        std=np.array(values["std"], np.float32),
        front=front,
    )


def _ends(session: ort.InferenceSession, where: str) -> tuple[ort.NodeArg, object]:
    """The input, and the number of classes if it is fixed."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if len(inputs) == len(outputs) == 1:
        (image,), (out,) = inputs, outputs
        fits = image.type in _DTYPES and out.type in _DTYPES and len(image.shape) == 4 and len(out.shape) == 2
        if fits and image.shape[1] == 3 and _square(image.shape[2], image.shape[3]):
            return image, out.shape[1]
    raise ModelError(f"{where}: not a front classifier of a known shape: {described(session)}; {ACCEPTED}")


def _square(height: object, width: object) -> bool:
    fixed = [isinstance(side, int) for side in (height, width)]
    return height == width if any(fixed) else True


def _fronts(notes: Mapping[str, str], classes: object, where: str) -> NDArray[np.float64]:
    default = FRONTS_DEG.get(classes, ()) if isinstance(classes, int) else ()
    degrees = np.array(_numbers(notes, "front_deg", " ".join(map(str, default)), where))
    if not len(degrees) or (isinstance(classes, int) and len(degrees) != classes):
        raise ModelError(
            f"{where}: it has {classes} classes and its metadata 'front_deg' gives {len(degrees)} fronts; one is "
            "needed for each class, degrees clockwise on the crop from +x, such as '0 180', or nan for no front"
        )
    front = np.radians(np.where(np.isfinite(degrees), degrees, np.nan))
    if (np.abs(np.sin(2.0 * front)) > 1e-6).any():
        raise ModelError(
            f"{where}: its metadata 'front_deg' is {notes['front_deg']!r}; a front is at a side of the crop: 0, 90, "
            "180 or 270"
        )
    return front


def _numbers(notes: Mapping[str, str], key: str, default: str, where: str) -> list[float]:
    text = notes.get(key, default)
    try:
        return [float(part) for part in text.strip("[]() ").replace(",", " ").split()]
    except ValueError:
        raise ModelError(f"{where}: its metadata {key!r} is {text!r}; numbers are needed") from None


def _in_range(key: str, values: list[float], where: str) -> list[float]:
    least, most = _RANGES[key]
    if len(values) != _COUNTS[key] or not all(least <= value <= most for value in values):
        raise ModelError(
            f"{where}: its metadata {key!r} is {values}; {_COUNTS[key]} between {least:g} and {most:g} must be there"
        )
    return values
