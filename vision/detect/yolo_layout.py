"""Layout of what a YOLO-OBB export takes and gives, read from its inputs, outputs and notes.

Outputs of Ultralytics' exports of YOLOv8-OBB, YOLO11-OBB and YOLO26-OBB (a = anchors, c = classes):

    raw      [b, 4 + c + 1, a]   x y w h, a score for each class, angle; suppression is left to us
    turned   [b, a, 4 + c + 1]   the same with its last two axes exchanged
    boxes    [b, most, 7]        x y w h score class angle, zeros below: suppression inside, or an end-to-end head
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import onnxruntime as ort

from vision.detect.onnx_model import described, metadata, shape_text, table
from vision.detect.yolo_classes import class_names

ACCEPTED = (
    "YOLO-OBB exports: one input [b, 3, H, W] float32 or float16, any of b, H, W fixed or not; one output, raw "
    "[b, 4 + classes + 1, anchors], the same turned [b, anchors, 4 + classes + 1], or suppressed or end-to-end "
    "[b, boxes, 7] = x y w h score class angle"
)
Form = Literal["raw", "turned", "boxes"]

STRIDE = 32
"""Coarsest step of a model that does not name it."""
SIDE = 1024
"""Canvas of a model that takes any size and does not name its own."""
LEVELS = ((8, 16, 32), (4, 8, 16, 32), (8, 16, 32, 64))
"""Strides of the grids of anchors: the plain heads, those with a finer and those with a coarser level."""
BOX_COLUMNS = 7
"""Columns of an output of boxes: x y w h, score, class, angle."""
_DIGITS = 18
"""Most digits of a number in the metadata."""
MAX_SIDE = 8192
"""Maximum side of a canvas, px."""
MAX_PIXELS = 1 << 25
"""Maximum pixels of all canvases of a run, 400 MB: 32 of 1024 × 1024."""
MAX_VALUES = 1 << 26
"""Maximum values of an output, 256 MB: 65,536 for each of 1,000 boxes, or 80 classes per anchor of 6000 × 6000 px."""
_KINDS: dict[str, np.dtype[np.float32] | np.dtype[np.float16]] = {
    "tensor(float)": np.dtype(np.float32),
    "tensor(float16)": np.dtype(np.float16),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class YoloInput:
    """The images that a model takes."""

    name: str
    kind: np.dtype[np.float32] | np.dtype[np.float16]
    """float32 or float16."""
    batch: int | None
    """Images in one run; None: any number."""
    height: int | None
    """px; None: any multiple of the stride."""
    width: int | None
    stride: int
    imgsz: tuple[int, int]
    """(height, width) px of the canvas that an image is fitted into."""
    names: Mapping[int, str]
    """Names of the classes; empty when unknown."""
    suppressed: bool
    """True if the output holds boxes, not anchors, by the metadata."""


def read_input(session: ort.InferenceSession, imgsz: int | None = None) -> YoloInput:
    """Input that a model takes.

    Args:
        imgsz: longest side of the canvas, px, for a model that takes any; None: as its metadata has it.

    Raises:
        ValueError: it is no YOLO-OBB export, or ``imgsz`` is not to be had.
    """
    notes = metadata(session)
    task = notes.get("task", "obb")
    if task != "obb":
        raise ValueError(f"its metadata name the task {task!r}; oriented boxes are the task 'obb'")
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if len(inputs) != 1 or len(outputs) != 1 or not _takes_images(inputs[0]) or len(outputs[0].shape) != 3:
        raise ValueError(f"not a detector of a known shape: {described(session)}")
    batch, _, height, width = (n if isinstance(n, int) and n > 0 else None for n in inputs[0].shape)
    stride = _number(notes.get("stride", ""), STRIDE)
    canvas = _canvas(height, width, notes, imgsz, stride)
    _bound(batch or 1, canvas, stride, outputs[0].shape)
    return YoloInput(
        name=inputs[0].name,
        kind=_KINDS[inputs[0].type],
        batch=batch,
        height=height,
        width=width,
        stride=stride,
        imgsz=canvas,
        names=class_names(notes),
        suppressed=notes.get("end2end") == "True" or _nms_inside(notes),
    )


def output_form(shape: tuple[int, ...], names: Mapping[int, str], anchors: frozenset[int], suppressed: bool) -> Form:
    """Tell how an output is to be read.

    Seven columns are boxes, unless the model has two classes (4 + 2 + 1 = 7) and as many rows as it has anchors.

    Args:
        names: of the classes; empty when unknown.
        anchors: how many anchors the input's size gives, see ``anchor_counts``.

    Raises:
        ValueError: it cannot be read; names what was found and what was expected.
    """
    if len(shape) != 3:
        raise ValueError(f"its output {shape_text(shape)} has {len(shape)} axes, not three")
    _, rows, columns = shape
    two = len(names) in (0, 2)
    if columns == BOX_COLUMNS and (suppressed or not (two and rows in anchors)):
        return "boxes"
    if names:
        deep = 4 + len(names) + 1
        if rows == deep and (columns != deep or columns in anchors):
            return "raw"
        if columns == deep:
            return "turned"
        raise ValueError(_misfit(shape, len(names)))
    # without names the axis as long as the number of anchors is theirs, else the longer one
    along = columns in anchors or (rows not in anchors and columns > rows)
    if min(rows, columns) < 6 or (rows if along else columns) < 6:
        raise ValueError(f"its output {shape_text(shape)} has no room for x y w h, a score and an angle")
    return "raw" if along else "turned"


def _bound(batch: int, canvas: tuple[int, int], stride: int, output: Sequence[object]) -> None:
    """Refuse what no image needs, before any memory is asked for.

    Raises:
        ValueError: names what is too large.
    """
    height, width = canvas
    if max(height, width, stride) > MAX_SIDE or batch * height * width > MAX_PIXELS:
        raise ValueError(
            f"it takes {batch} × {width} × {height} px in steps of {stride} px; the most are {MAX_SIDE} px a side and "
            f"{MAX_PIXELS} in all"
        )
    check_size([n for n in output if isinstance(n, int) and n > 0])


def check_size(output: Sequence[int]) -> None:
    """Refuse an output that is too large to be searched.

    Raises:
        ValueError: it is.
    """
    if math.prod(output) > MAX_VALUES:
        raise ValueError(f"its output {shape_text(output)} has more than {MAX_VALUES} numbers")


def anchor_counts(height: int, width: int) -> frozenset[int]:
    """Return the numbers of anchors that models have on a canvas, px: one for each cell of each level's grid."""
    return frozenset(sum(-(-height // s) * -(-width // s) for s in strides) for strides in LEVELS)


def _misfit(shape: tuple[int, ...], classes: int) -> str:
    _, rows, columns = shape
    text = f"its output {shape_text(shape)} does not fit its {classes} classes, which need {4 + classes + 1} rows"
    if columns == 6 or classes + 4 in (rows, columns):
        return f"{text} with the angle; these look like upright boxes"
    return text


def _takes_images(image: ort.NodeArg) -> bool:
    return (
        image.type in _KINDS and len(image.shape) == 4 and (image.shape[1] == 3 or not isinstance(image.shape[1], int))
    )


def _canvas(
    height: int | None, width: int | None, notes: Mapping[str, str], imgsz: int | None, stride: int
) -> tuple[int, int]:
    """(height, width): fixed by the input, else as asked for, else as its metadata has it, ``[height, width]``."""
    if height is not None and width is not None:
        if imgsz is not None and imgsz != max(height, width):
            raise ValueError(
                f"it takes {width} × {height} px only, {imgsz} px cannot be had; export it with dynamic=True"
            )
        return height, width
    if imgsz is not None:
        if imgsz < stride:
            raise ValueError(f"a canvas of {imgsz} px is smaller than its step of {stride} px")
        own = [imgsz]
    else:
        own = [number for n in notes.get("imgsz", "").strip("[]() ").split(",") if (number := _number(n.strip(), 0))]
    sides = [-(-n // stride) * stride for n in own] or [SIDE]
    return height or sides[0], width or sides[-1]


def _nms_inside(notes: Mapping[str, str]) -> bool:
    try:
        return bool(table(notes.get("args", "")).get("nms"))
    except ValueError:
        return False


def _number(text: str, default: int) -> int:
    if not (text.isdecimal() and text.isascii()):
        return default
    # more digits are no side of an image, whatever they are
    return int(text[:_DIGITS]) or default
