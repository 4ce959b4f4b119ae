"""A detector from any YOLO-OBB export: it does not find fronts, so headings are NaN.

An image is fitted into the model's canvas. Where the smallest vehicles would become too small by that, it is looked at
in tiles; where the ground resolution is unknown, the vehicles tell whether they would
(``vision.detect.apparent_length``).
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Sequence
from dataclasses import replace
from functools import partial
from threading import Lock

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from vision.detect.apparent_length import CAR_M, FLOOR, ApparentLength, examine, finish
from vision.detect.decode_yolo import Dropped, Rule, decode_boxes, decode_raw
from vision.detect.detections import Detections
from vision.detect.letterbox import Letterbox, draw, undo
from vision.detect.onnx_model import RUN_ERRORS, described, why
from vision.detect.tiles import OVERLAP_LENGTHS, Tile, detect_in_tiles, tile_grid
from vision.detect.yolo_classes import vehicle_classes
from vision.detect.yolo_layout import ACCEPTED, anchor_counts, check_size, output_form, read_input
from vision.errors import ModelError

Image = NDArray[np.uint8]

VEHICLE_M = 2.5
"""Length of the smallest vehicle that matters."""
MIN_LENGTH_PX, GOOD_LENGTH_PX = 12.0, 16.0
"""An image is tiled when such a vehicle would be shorter on the canvas than the first, so that it has the second."""
MAX_TILES, FILM_TILES = 16, 6
"""Tiles of one image, which bounds the time, and of a frame of a film whose scale the vehicles alone tell. Six are
3 × 2 in a frame of 16:9, enough for a canvas of 640 px to see 1080 lines almost as they are; each takes as long as a
whole frame, and with more of them a film would be followed at a frame or two a second for a length that is a guess."""
FINEST = 2.0
"""Largest scale at which vehicles are measured: those that are small at full size are found at two scales too."""
STILL_RUNS, FILM_RUNS = 4.0, 1.0
"""Area that is looked at at one scale to find the scale of an image, and of a film meanwhile, in whole canvases."""
UNNAMED = 1000
"""Classes that a model without names may number its boxes with."""


class YoloDetector:
    """Detector that runs a YOLO-OBB export; see ``vision.detect.yolo_layout`` for the exports that are read.

    Args:
        score: boxes of this score or less are dropped.
        classes: names of the classes that count; None: those that sound like vehicles.
        imgsz: longest side of the canvas, px, for a model that takes any.
        per_class: keep a box for each class that claims a vehicle, as Ultralytics' predictor does by itself.
        tiled: use tiles when vehicles would become too small.

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
        """Counts of what outputs held so far that could be no box, or was too much."""
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
        if gsd_m is None or not np.isfinite(gsd_m) or gsd_m <= 0.0:
            gsd_m = self._gsd_of_still(image)
        tiles = self._tiles(image, gsd_m)
        return detect_in_tiles(image, tiles, self._detect_fitted) if tiles else self._detect_fitted([image])[0]

    def examine(self, image: Image, runs: float = FILM_RUNS) -> Generator[None, None, ApparentLength | None]:
        """See ``vision.detect.detector.MeasuringDetector``; nothing is looked at where no length would make tiles.

        Args:
            image: (H, W, 3) BGR.
            runs: how much is looked at at one scale, in whole canvases.
        """
        whole = self._whole(image)
        if not self._tiled or whole >= 1.0:
            return None
        most_px = runs * whole**2 * image.shape[0] * image.shape[1]
        return (yield from examine(image, self._look, finest=FINEST, most_px=most_px))

    def film_gsd_m(self, image: Image, length_px: float | None) -> float:
        """See ``vision.detect.detector.MeasuringDetector``."""
        if length_px is None:
            return self._whole_gsd_m(image)
        gsd_m = CAR_M / length_px
        while len(self._tiles(image, gsd_m)) > FILM_TILES:
            gsd_m *= 0.95
        return gsd_m

    def _gsd_of_still(self, image: Image) -> float:
        found = finish(self.examine(image, STILL_RUNS))
        return CAR_M / found.px if found else self._whole_gsd_m(image)

    def _whole(self, image: Image) -> float:
        """Return the factor by which an image (H, W, 3) is scaled when the whole of it is fitted into the canvas."""
        high, wide = self._input.imgsz
        return float(min(high / image.shape[0], wide / image.shape[1]))

    def _whole_gsd_m(self, image: Image) -> float:
        """A ground resolution at which an image (H, W, 3) needs no tiles."""
        return VEHICLE_M * self._whole(image) / GOOD_LENGTH_PX

    def _tiles(self, image: Image, gsd_m: float) -> tuple[Tile, ...]:
        """The tiles that keep vehicles visible; empty: no need."""
        height, width = image.shape[:2]
        high, wide = self._input.imgsz
        whole, length_px = self._whole(image), VEHICLE_M / gsd_m
        scale = min(GOOD_LENGTH_PX / length_px, 1.0)
        if not self._tiled or length_px * whole >= MIN_LENGTH_PX or whole >= scale:
            return ()
        while scale > whole:
            size = (round(wide / scale), round(high / scale))
            tiles = tile_grid((width, height), size, OVERLAP_LENGTHS * length_px)
            if len(tiles) <= MAX_TILES:
                return tiles
            scale *= 0.9
        return ()

    def _look(self, image: Image, scale: float) -> Detections:
        """Vehicles of an image at a scale, also weak ones."""
        high, wide = self._input.imgsz
        size = (max(round(wide / scale), 1), max(round(high / scale), 1))
        tiles = tile_grid((image.shape[1], image.shape[0]), size, OVERLAP_LENGTHS * GOOD_LENGTH_PX / scale)
        rule = replace(self._rule, score=FLOOR)
        return detect_in_tiles(image, tiles, partial(self._detect_fitted, most=scale, rule=rule))

    def _detect_fitted(
        self, images: Sequence[Image], most: float = np.inf, rule: Rule | None = None
    ) -> list[Detections]:
        """Vehicles of images, each fitted into the canvas, in its own pixels.

        Args:
            images: each (H, W, 3).
            rule: which boxes are returned, None the detector's own.
        """
        need, found = self._input, []
        step = need.stride if need.height is None and need.width is None else None
        count = need.batch or 1
        for start in range(0, len(images), count):
            some = images[start : start + count]
            fits = [Letterbox.fit((i.shape[1], i.shape[0]), need.imgsz[::-1], most=most, step=step) for i in some]
            outputs = self._run([draw(i, fit, average=False) for i, fit in zip(some, fits, strict=True)])
            found += [
                undo(self._decode(o, rule or self._rule), fit, i) for o, fit, i in zip(outputs, fits, some, strict=True)
            ]
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
            raise ModelError(f"{self._where}: cannot be run on a {size} image: {why(error)}") from error
        try:
            check_size(out.shape)
        except ValueError as error:
            raise ModelError(f"{self._where}: {error}") from error
        if out.ndim != 3 or len(out) < len(canvases):
            raise ModelError(
                f"{self._where}: gave an output {list(out.shape)} for {len(canvases)} images; accepted are {ACCEPTED}"
            )
        return list(out[: len(canvases)])

    def _decode(self, out: NDArray[np.floating], rule: Rule) -> Detections:
        """Boxes in pixels of the canvas."""
        axis = 0 if self._form == "raw" else 1
        if out.shape[axis] != self._shape[axis]:
            raise ModelError(f"{self._where}: gave an output {list(out.shape)} after one of {list(self._shape)}")
        if self._form == "boxes":
            found, dropped = decode_boxes(out, self._classes, rule)
        else:
            found, dropped = decode_raw(out if self._form == "raw" else out.T, rule)
        with self._counting:
            self.dropped += dropped
        return found
