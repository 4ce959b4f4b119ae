"""The bundled detector: it finds fronts, and the image is scaled so that vehicles have the length it was trained for.

The model's contract (``training/export.py`` writes it): input ``image`` [1, H, W, 3] uint8 BGR, sides multiples
of 32; output ``map`` [1, 9, H/4, W/4] float32 as read by ``vision.detect.decode_heatmap``; metadata ``rollcall``
(version), ``stride``, ``nominal_length_m`` and ``nominal_length_px``: a vehicle of this many metres is found best at
this many pixels.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from functools import partial

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from vision.detect import decode_heatmap
from vision.detect.apparent_length import CAR_M, FLOOR, ApparentLength, examine, finish
from vision.detect.detections import Detections
from vision.detect.letterbox import letterbox, undo
from vision.detect.onnx_model import RUN_ERRORS, described, metadata, why
from vision.detect.tiles import OVERLAP_LENGTHS, Tile, detect_in_tiles, tile_grid
from vision.errors import ModelError

Image = NDArray[np.uint8]

ACCEPTED = "Rollcall's own (image [1, H, W, 3] uint8 → map [1, 9, H/4, W/4], metadata 'rollcall', 'stride')"

DEFAULT_SCALE, DEFAULT_WIDTH = 0.5, 960
"""Scale of images in which nothing tells the scale: reduced by this much, but not made narrower than this many px, nor
enlarged."""
ENOUGH_M = 2.4
"""Length of a vehicle at the size at which it suffices to see vehicles in films in which they alone tell the scale,
where more would take longer than the scale above."""
STILL_PX, FILM_PX = 1 << 20, 400_000
"""Pixels that are looked at at one scale to find the scale of an image, and of a film meanwhile."""
SIDE_STEP = 32
"""Sides of a canvas are multiples of this, px."""
MIN_SIDE, MAX_SIDE = 64, 4096
"""Limits of a canvas side, px. Larger images are processed in tiles, which bounds the memory."""
MAX_SCALE = 2.0
"""Enlarging an image further adds no detail."""


FRAME_PX = 400_000.0
"""Pixels of the canvas that 50 ms of a server's thread are enough for."""
PART_PRICE, QUICK_PART_PRICE = 1.3, 0.8
"""Time of a pixel in a part, of one in a whole image, as measured: of the same network, and of one in 8 bits."""


class HeatmapDetector:
    """Detector that reads vehicles from a network's heat map; see the module for the model's contract.

    Args:
        parts: a quicker network that gives the same map, for parts of images; None: the same one.
        frame_px: see ``vision.detect.detector.PartialDetector``.

    Raises:
        ModelError: the metadata names Rollcall's detector, but the model has another shape.
    """

    def __init__(
        self,
        session: ort.InferenceSession,
        where: str,
        *,
        score: float,
        parts: ort.InferenceSession | None = None,
        frame_px: float = FRAME_PX,
    ) -> None:
        notes = metadata(session)
        self._session, self._parts = session, parts or session
        self.frame_px = frame_px
        self.part_price = QUICK_PART_PRICE if parts else PART_PRICE
        self._where = where
        self._score = score
        try:
            self._stride = int(_ranged(notes, "stride", 1, SIDE_STEP))
            self._length_px = _ranged(notes, "nominal_length_px", 1, MAX_SIDE)
            self._px_per_m = self._length_px / _ranged(notes, "nominal_length_m", 0.01, 100)
        except (KeyError, ValueError, ZeroDivisionError) as error:
            raise ModelError(
                f"{where}: metadata {error} of a Rollcall model is missing or no number; export it again"
            ) from error
        _check_map(session, where)

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """See ``vision.detect.detector.Detector``."""
        height, width = image.shape[:2]
        known = gsd_m is not None and np.isfinite(gsd_m) and gsd_m > 0.0
        scale = self.scale(gsd_m) if known and gsd_m else self._scale_of_still(image)
        if max(width, height) * scale <= MAX_SIDE:
            return self._detect_at_scale(image, scale, self._score)
        side = int(MAX_SIDE / scale)
        tiles = tile_grid((width, height), (side, side), OVERLAP_LENGTHS * self._length_px / scale)
        return detect_in_tiles(
            image, tiles, lambda parts: [self._detect_at_scale(part, scale, self._score) for part in parts]
        )

    def scale(self, gsd_m: float) -> float:
        """See ``vision.detect.detector.PartialDetector``."""
        return min(gsd_m * self._px_per_m, MAX_SCALE)

    def detect_in(self, image: Image, parts: Sequence[Tile], *, gsd_m: float) -> Detections:
        """See ``vision.detect.detector.PartialDetector``; sides that are whole steps of a canvas are seen at once."""
        scale = self.scale(gsd_m)

        def look(part: Image) -> Detections:
            columns, rows = (max(round(side * scale / SIDE_STEP), 1) for side in (part.shape[1], part.shape[0]))
            return self._detect_on(part, (columns * SIDE_STEP, rows * SIDE_STEP), self._score, self._parts)

        return detect_in_tiles(image, parts, lambda images: [look(part) for part in images])

    def examine(self, image: Image, most_px: int = FILM_PX) -> Generator[None, None, ApparentLength | None]:
        """Measure the length of vehicles in an image, see ``vision.detect.apparent_length.examine``."""
        return examine(image, partial(self._detect_at_scale, score=FLOOR), finest=MAX_SCALE, most_px=most_px)

    def film_gsd_m(self, image: Image, length_px: float | None) -> float:
        """See ``vision.detect.detector.MeasuringDetector``."""
        scale = default_scale(image)
        if length_px is not None:
            best, enough = (self._px_per_m * metres / length_px for metres in (CAR_M, ENOUGH_M))
            scale = min(max(enough, min(best, scale)), MAX_SCALE)
        return float(scale / self._px_per_m)

    def _scale_of_still(self, image: Image) -> float:
        found = finish(self.examine(image, STILL_PX))
        if found is None:
            return default_scale(image)
        return float(min(CAR_M / found.px * self._px_per_m, MAX_SCALE))

    def _detect_at_scale(self, image: Image, scale: float, score: float) -> Detections:
        return self._detect_on(image, _canvas(image.shape[1], image.shape[0], scale), score, self._session)

    def _detect_on(
        self, image: Image, size: tuple[int, int], score: float, session: ort.InferenceSession
    ) -> Detections:
        """Look at an image on a canvas of some width and height."""
        canvas, fit = letterbox(image, size)
        try:
            (cells,) = session.run(None, {"image": canvas[None]})
        except RUN_ERRORS as error:
            raise ModelError(
                f"{self._where}: cannot be run on a {fit.width} × {fit.height} image: {why(error)}"
            ) from error
        wanted = (1, decode_heatmap.CHANNELS, fit.height // self._stride, fit.width // self._stride)
        if cells.shape != wanted:
            raise ModelError(f"{self._where}: gave a map {list(cells.shape)}, wanted {list(wanted)}; {ACCEPTED}")
        return undo(decode_heatmap.decode(cells[0], self._stride, score), fit, image)


def default_scale(image: Image) -> float:
    """Return the scale of an image (H, W, 3) in which nothing tells the scale."""
    return max(DEFAULT_SCALE, min(DEFAULT_WIDTH / float(max(image.shape[:2])), 1.0))


def _ranged(notes: Mapping[str, str], key: str, least: float, most: float) -> float:
    value = float(notes[key])
    if not least <= value <= most:
        raise ValueError(f"{key!r} is {value:g}; it must lie between {least:g} and {most:g}")
    return value


def _check_map(session: ort.InferenceSession, where: str) -> None:
    inputs, outputs = session.get_inputs(), session.get_outputs()
    fits = (
        len(inputs) == 1
        and inputs[0].name == "image"
        and inputs[0].type == "tensor(uint8)"
        and len(inputs[0].shape) == 4
        and inputs[0].shape[3] == 3
        and not any(isinstance(n, int) for n in inputs[0].shape[1:3])
        and len(outputs) == 1
        and len(outputs[0].shape) == 4
        and outputs[0].shape[1] == decode_heatmap.CHANNELS
    )
    if not fits:
        raise ModelError(
            f"{where}: is marked as Rollcall's, but is not of its shape: {described(session)}; accepted are {ACCEPTED}"
        )


def _canvas(width: int, height: int, scale: float) -> tuple[int, int]:
    """(width, height) of the model's input: the nearest sides that are multiples of 32, neither tiny nor huge."""
    wide = max(width, height)
    scale = max(min(scale, MAX_SIDE / wide), MIN_SIDE / wide)
    columns = max(round(width * scale / SIDE_STEP), 1)
    # the height follows from the width that was chosen, rounded up: the image fills the width
    rows = max(int(np.ceil(height * columns / width - 1e-9)), 1)
    return columns * SIDE_STEP, rows * SIDE_STEP
