"""A detector from any YOLO-OBB export: it does not find fronts, so headings are NaN."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from threading import Lock

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from vision.detect.decode_yolo import Dropped, Rule, decode_boxes, decode_raw
from vision.detect.detections import Detections
from vision.detect.letterbox import Letterbox, draw, undo
from vision.detect.onnx_model import RUN_ERRORS, described
from vision.detect.tiles import detect_in_tiles, tile_grid
from vision.detect.yolo_classes import vehicle_classes
from vision.detect.yolo_layout import ACCEPTED, anchor_counts, check_size, output_form, read_input
from vision.errors import ModelError

__all__ = ["YoloDetector"]

Image = NDArray[np.uint8]

VEHICLE_M = 2.5
"""Length of the smallest vehicle that matters."""
LEAST_LENGTH_PX, GOOD_LENGTH_PX = 12.0, 16.0
"""An image is tiled when such a vehicle would be shorter on the canvas than the first, so that it has the second."""
OVERLAP_LENGTHS = 4.0
"""Overlap of tiles, in vehicles: lorries are twice as long."""
MOST_TILES = 16
"""Of one image; bounds the time."""
UNNAMED = 1000
"""Classes that a model without names may number its boxes with."""


class YoloDetector:
    """See ``vision.detect.yolo_layout`` for the exports that are read.

    Args:
        session: the model.
        where: what to call it in errors.
        score: boxes of this score or less are dropped.
        classes: names of the classes that count; None: those that sound like vehicles.
        imgsz: longest side of the canvas, px, for a model that takes any.
        per_class: keep a box for each class that claims a vehicle, as Ultralytics' predictor does by itself.
        tiled: use tiles when the ground resolution is known and vehicles would become too small.

    Raises:
        ModelError: the model is none of the accepted, or none of its classes counts.
    """

    def __init__(
        self,
        session: ort.InferenceSession,
        where: str,
        *,
        score: float,
        classes: Collection[str] | None = None,
        imgsz: int | None = None,
        per_class: bool = False,
        tiled: bool = True,
    ) -> None:
        self.dropped = Dropped()
        """What outputs held so far that could be no box, or was too much."""
        self._counting = Lock()
        self._session, self._where, self._tiled = session, where, tiled
        try:
            self._input = read_input(session, imgsz)
            canvas = np.zeros((*self._input.imgsz, 3), np.uint8)
            self._shape = self._run([canvas])[0].shape
            names = self._input.names
            self._form = output_form((1, *self._shape), names, anchor_counts(*canvas.shape[:2]), self._input.suppressed)
            depth = self._shape[0] if self._form == "raw" else self._shape[1]
            self._classes = (len(names) or UNNAMED) if self._form == "boxes" else depth - 5
            chosen = vehicle_classes(names, self._classes, classes)
        except ValueError as error:
            raise ModelError(f"{where}: {error}; accepted are {ACCEPTED}. The model: {described(session)}") from error
        self._rule = Rule(classes=chosen, score=score, per_class=per_class)

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """See ``vision.detect.detector.Detector``; boxes of any class that counts, headings NaN."""
        tile = self._tile(image, gsd_m)
        if tile is None:
            return self._detect_fitted([image])[0]
        size, overlap = tile
        return detect_in_tiles(image, tile_grid((image.shape[1], image.shape[0]), size, overlap), self._detect_fitted)

    def _tile(self, image: Image, gsd_m: float | None) -> tuple[tuple[int, int], float] | None:
        """(width, height) and overlap, px of the image, of the tiles that keep vehicles visible; None: no need."""
        if not self._tiled or gsd_m is None or not np.isfinite(gsd_m) or gsd_m <= 0.0:
            return None
        height, width = image.shape[:2]
        high, wide = self._input.imgsz
        whole, length_px = min(wide / width, high / height), VEHICLE_M / gsd_m
        scale = min(GOOD_LENGTH_PX / length_px, 1.0)
        if length_px * whole >= LEAST_LENGTH_PX or whole >= scale:
            return None
        overlap = OVERLAP_LENGTHS * length_px
        while scale > whole:
            size = (round(wide / scale), round(high / scale))
            if len(tile_grid((width, height), size, overlap)) <= MOST_TILES:
                return size, overlap
            scale *= 0.9
        return None

    def _detect_fitted(self, images: Sequence[Image]) -> list[Detections]:
        """Vehicles of images, each fitted into the canvas, in its own pixels."""
        need, found = self._input, []
        step = need.stride if need.height is None and need.width is None else None
        count = need.batch or 1
        for start in range(0, len(images), count):
            some = images[start : start + count]
            fits = [Letterbox.fit((i.shape[1], i.shape[0]), need.imgsz[::-1], step=step) for i in some]
            outputs = self._run([draw(i, fit, average=False) for i, fit in zip(some, fits, strict=True)])
            found += [undo(self._decode(o), fit, i) for o, fit, i in zip(outputs, fits, some, strict=True)]
        return found

    def _run(self, canvases: Sequence[Image]) -> list[NDArray[np.floating]]:
        """Outputs, each without its batch axis, of at most one batch of canvases (height, width, 3) of one size."""
        need = self._input
        batch = np.zeros((need.batch or len(canvases), 3, *canvases[0].shape[:2]), need.kind)
        for planes, canvas in zip(batch, canvases, strict=False):
            # BGR bytes → RGB planes in 0..1
            planes[:] = canvas[:, :, ::-1].transpose(2, 0, 1) / np.float32(255.0)
        try:
            (out,) = self._session.run(None, {need.name: batch})
        except RUN_ERRORS as error:
            size = " × ".join(str(n) for n in batch.shape)
            raise ModelError(f"{self._where}: cannot be run on a {size} image: {error}") from error
        try:
            check_size(out.shape)
        except ValueError as error:
            raise ModelError(f"{self._where}: {error}") from error
        if out.ndim != 3 or len(out) < len(canvases):
            raise ModelError(
                f"{self._where}: gave an output {list(out.shape)} for {len(canvases)} images; accepted are {ACCEPTED}"
            )
        return list(out[: len(canvases)])

    def _decode(self, out: NDArray[np.floating]) -> Detections:
        """Boxes in pixels of the canvas."""
        axis = 0 if self._form == "raw" else 1
        if out.shape[axis] != self._shape[axis]:
            raise ModelError(f"{self._where}: gave an output {list(out.shape)} after one of {list(self._shape)}")
        if self._form == "boxes":
            found, dropped = decode_boxes(out, self._classes, self._rule)
        else:
            found, dropped = decode_raw(out if self._form == "raw" else out.T, self._rule)
        with self._counting:
            self.dropped += dropped
        return found
