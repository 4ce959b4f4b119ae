"""Oriented vehicle detectors behind one protocol: the bundled model, and any YOLO-OBB export.

The bundled model's contract (``vision/training/export.py`` writes it): input ``image`` [1, H, W, 3] uint8 BGR, sides
multiples of 32; output ``map`` [1, 9, H/4, W/4] float32 as read by ``vision.decode_heatmap``; metadata ``rollcall``
(version), ``stride``, ``nominal_length_m`` and ``nominal_length_px``: a vehicle of so many metres is found best at so
many pixels.

A YOLO-OBB export's: one input [1, 3, H, W] float32 RGB in 0..1; one output [1, 4 + classes + 1, N], suppression not
included.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

from vision import decode_heatmap, decode_yolo
from vision.boxes import wrap
from vision.detections import Detections
from vision.errors import ModelError
from vision.letterbox import Letterbox, letterbox

__all__ = ["BUNDLED", "Detector", "HeatmapDetector", "YoloDetector", "open_detector"]

Image = NDArray[np.uint8]

BUNDLED = Path(__file__).parent / "models" / "rollcall-obb-s.onnx"
DEFAULT_SCALE = 0.5
"""How the bundled model sees pictures of unknown ground resolution."""
SIDE_STEP = 32
LEAST_SIDE, MOST_SIDE = 64, 4096
MOST_SCALE = 2.0
"""Enlarging a picture further adds no detail."""
YOLO_SIDE = 1024
"""Canvas for YOLO exports that take any size and do not name theirs."""
ACCEPTED = (
    "accepted are Rollcall's own (image [1, H, W, 3] uint8 → map [1, 9, H/4, W/4], metadata 'rollcall', 'stride') and "
    "YOLO-OBB exports ([1, 3, H, W] float32 → [1, 4 + classes + 1, N], suppression not included)"
)
_LOAD_ERRORS = (
    ort_errors.Fail, ort_errors.InvalidArgument, ort_errors.InvalidGraph, ort_errors.InvalidProtobuf,
    ort_errors.NoSuchFile, ort_errors.NotImplemented, ort_errors.NoModel, ort_errors.RuntimeException,
)  # fmt: skip


class Detector(Protocol):
    """Finds vehicles in one picture."""

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """Vehicles in a picture.

        Args:
            image: (H, W, 3) BGR.
            gsd_m: metres on the ground per pixel at the picture's middle, when the camera's pose is known.

        Returns:
            Detections in continuous pixels of this picture, best first.
        """


class HeatmapDetector:
    """The bundled model: the picture is scaled so that a vehicle has the length that the model knows best."""

    def __init__(self, session: ort.InferenceSession, where: str, *, score: float) -> None:
        metadata = _metadata(session)
        self._session = session
        self._score = score
        try:
            self._stride = int(metadata["stride"])
            self._px_per_m = float(metadata["nominal_length_px"]) / float(metadata["nominal_length_m"])
        except (KeyError, ValueError) as error:
            raise ModelError(
                f"{where}: metadata {error} of a Rollcall model is missing or no number; export it again"
            ) from error
        _check_map(session, where)

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """See ``Detector``."""
        height, width = image.shape[:2]
        scale = DEFAULT_SCALE if gsd_m is None or not np.isfinite(gsd_m) or gsd_m <= 0.0 else gsd_m * self._px_per_m
        canvas, fit = letterbox(image, _canvas(width, height, scale))
        (cells,) = self._session.run(None, {"image": canvas[None]})
        return _undo(decode_heatmap.decode(cells[0], self._stride, self._score), fit, width, height)


class YoloDetector:
    """A YOLO-OBB export; it sees the whole picture at the size it was made for."""

    def __init__(
        self, session: ort.InferenceSession, where: str, *, score: float, classes: Collection[str] | None = None
    ) -> None:
        metadata = _metadata(session)
        self._session, self._where, self._score = session, where, score
        self._input = session.get_inputs()[0].name
        self._canvas = _yolo_canvas(session, metadata)
        channels = session.get_outputs()[0].shape[1]
        try:
            names = decode_yolo.class_names(metadata)
            count = channels - 5 if isinstance(channels, int) else len(names)
            if count < 1 or (names and count != len(names)):
                raise ValueError(
                    f"its output has {channels} rows, {len(names)} classes need {4 + len(names) + 1} with the angle"
                )
            self._classes = decode_yolo.vehicle_classes(names, count, classes)
        except ValueError as error:
            raise ModelError(f"{where}: {error}; {ACCEPTED}") from error
        self._rows = 5 + count

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """See ``Detector``."""
        height, width = image.shape[:2]
        canvas, fit = letterbox(image, self._canvas)
        planes = np.ascontiguousarray(canvas[:, :, ::-1].transpose(2, 0, 1), dtype=np.float32) / np.float32(255.0)
        (out,) = self._session.run(None, {self._input: planes[None]})
        if out.ndim != 3 or out.shape[:2] != (1, self._rows):
            raise ModelError(
                f"{self._where}: gave an output of shape {list(out.shape)}, wanted [1, {self._rows}, N]; {ACCEPTED}"
            )
        return _undo(decode_yolo.decode(out[0], self._classes, self._score), fit, width, height)


def open_detector(
    path: Path | None = None,
    *,
    score: float = 0.3,
    providers: Sequence[str] | None = None,
    threads: int = 1,
    classes: Collection[str] | None = None,
) -> Detector:
    """Load a detector.

    Args:
        path: an ONNX file; None = the bundled model.
        score: smallest score of a detection: raise → fewer false alarms, lower → fewer misses.
        providers: onnxruntime execution providers in order of preference; None = the CPU.
        threads: CPU threads of one detection.
        classes: names of a YOLO model's classes that count; None = those that sound like vehicles.

    Raises:
        ModelError: no such file, not an ONNX model, not a shape that is known, or a provider that is not installed.
    """
    where = str(path or BUNDLED)
    session = _session(path or BUNDLED, tuple(providers or ("CPUExecutionProvider",)), threads)
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if "rollcall" in _metadata(session):
        return HeatmapDetector(session, where, score=score)
    if len(inputs) == len(outputs) == 1 and _is_yolo(inputs[0], outputs[0]):
        return YoloDetector(session, where, score=score, classes=classes)
    raise ModelError(f"{where}: not a detector of a known shape: {_found(session)}; {ACCEPTED}")


def _session(path: Path, providers: tuple[str, ...], threads: int) -> ort.InferenceSession:
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; give the path of an ONNX detector, or none for the bundled one")
    missing = set(providers) - set(ort.get_available_providers())
    if missing:
        installed = ", ".join(ort.get_available_providers())
        raise ModelError(f"{', '.join(sorted(missing))}: not offered by this onnxruntime; choose from {installed}")
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return ort.InferenceSession(str(path), options, providers=list(providers))
    except _LOAD_ERRORS as error:
        raise ModelError(f"{path}: cannot be loaded as an ONNX model: {error}") from error


def _check_map(session: ort.InferenceSession, where: str) -> None:
    inputs, outputs = session.get_inputs(), session.get_outputs()
    fits = (
        len(inputs) == 1 and inputs[0].name == "image" and inputs[0].type == "tensor(uint8)"
        and len(inputs[0].shape) == 4 and inputs[0].shape[3] == 3
        and not any(isinstance(n, int) for n in inputs[0].shape[1:3])
        and len(outputs) == 1 and len(outputs[0].shape) == 4 and outputs[0].shape[1] == decode_heatmap.CHANNELS
    )  # fmt: skip
    if not fits:
        raise ModelError(f"{where}: says it is Rollcall's, but is not of its shape: {_found(session)}; {ACCEPTED}")


def _is_yolo(image: ort.NodeArg, out: ort.NodeArg) -> bool:
    return (
        image.type == "tensor(float)" and len(image.shape) == 4 and image.shape[1] == 3
        and out.type == "tensor(float)" and len(out.shape) == 3
        and not (isinstance(out.shape[1], int) and isinstance(out.shape[2], int) and out.shape[1] >= out.shape[2])
    )  # fmt: skip


def _yolo_canvas(session: ort.InferenceSession, metadata: Mapping[str, str]) -> tuple[int, int]:
    """(width, height) that the model takes: fixed by its input, else by its metadata ``imgsz``, "[height, width]"."""
    height, width = session.get_inputs()[0].shape[2:]
    if isinstance(height, int) and isinstance(width, int):
        return width, height
    numbers = [int(n) for n in metadata.get("imgsz", "").strip("[]() ").split(",") if n.strip().isdigit()]
    return (numbers[-1], numbers[0]) if numbers else (YOLO_SIDE, YOLO_SIDE)


def _canvas(width: int, height: int, scale: float) -> tuple[int, int]:
    """(width, height) of the model's input: the nearest sides that are multiples of 32, neither tiny nor huge."""
    wide = max(width, height)
    scale = max(min(scale, MOST_SCALE, MOST_SIDE / wide), LEAST_SIDE / wide)
    columns = max(round(width * scale / SIDE_STEP), 1)
    # the height follows from the width that was chosen, rounded up: the picture fills the width
    rows = max(int(np.ceil(height * columns / width - 1e-9)), 1)
    return columns * SIDE_STEP, rows * SIDE_STEP


def _undo(found: Detections, fit: Letterbox, width: int, height: int) -> Detections:
    """From the canvas to the picture; boxes centred on the margins are dropped."""
    boxes = fit.undo_boxes(found.boxes)
    cx, cy, w, h, _ = boxes.T
    in_picture = replace(found, cx=cx, cy=cy, w=w, h=h, angle=wrap(found.angle))
    return in_picture.take((cx >= 0.0) & (cx <= width) & (cy >= 0.0) & (cy <= height))


def _metadata(session: ort.InferenceSession) -> dict[str, str]:
    return dict(session.get_modelmeta().custom_metadata_map)


def _found(session: ort.InferenceSession) -> str:
    def told(values: Sequence[ort.NodeArg]) -> str:
        return ", ".join(f"{v.name} {v.shape} {v.type.removeprefix('tensor(').rstrip(')')}" for v in values)

    return f"{told(session.get_inputs())} → {told(session.get_outputs())}"
