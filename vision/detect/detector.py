"""Oriented vehicle detectors behind one protocol: the bundled model, and any YOLO-OBB export."""

from __future__ import annotations

from collections.abc import Collection, Generator, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from vision.detect.apparent_length import ApparentLength
from vision.detect.detections import Detections
from vision.detect.heatmap_detector import HeatmapDetector
from vision.detect.onnx_model import metadata, open_session
from vision.detect.tiles import Tile
from vision.detect.yolo_detector import YoloDetector
from vision.errors import ModelError

BUNDLED = Path(__file__).parents[1] / "models" / "rollcall-obb-s.onnx"
"""Rollcall's own detector."""
BUNDLED_PARTS = BUNDLED.with_name("rollcall-obb-s-int8.onnx")
"""Rollcall's own detector with 8-bit arithmetic, for parts of pictures that are looked at in turns."""
CPU = ("CPUExecutionProvider",)


class Detector(Protocol):
    """Finds vehicles in one image; may be asked from several threads at once."""

    def detect(self, image: NDArray[np.uint8], *, gsd_m: float | None = None) -> Detections:
        """Vehicles in an image.

        Args:
            image: (H, W, 3) BGR.
            gsd_m: metres on the ground per pixel at the image's middle, when the camera's pose is known.

        Returns:
            Detections in continuous pixels of this image, best first; heading NaN where the front is unknown.
        """


@runtime_checkable
class DetectorAround(Protocol):
    """A detector that adds to what another finds, or takes from it."""

    detector: Detector


@runtime_checkable
class MeasuringDetector(Detector, Protocol):
    """A detector that finds the scale of images by the vehicles in them."""

    def examine(self, image: NDArray[np.uint8]) -> Generator[None, None, ApparentLength | None]:
        """Measure the length of vehicles in an image (H, W, 3), by a little work each time that the generator is
        continued."""

    def film_gsd_m(self, image: NDArray[np.uint8], length_px: float | None) -> float:
        """The ground resolution to ask ``detect`` for in a film in which nothing but the vehicles tells it, m per px.

        Args:
            image: (H, W, 3) any frame.
            length_px: how long vehicles are in it, None unknown.
        """


@runtime_checkable
class PartialDetector(Detector, Protocol):
    """A detector that can look at parts of an image, at the scale of the whole.

    Attributes:
        frame_px: pixels of its canvas that a frame of a flight has time for; inf: for any picture.
        part_price: of a pixel in a part, in those of a whole image: what is small takes longer, or has a network of its
            own that is quicker.
    """

    frame_px: float
    part_price: float

    def scale(self, gsd_m: float) -> float:
        """Return the factor by which an image of a ground resolution, m per px, is scaled to be looked at."""

    def detect_in(self, image: NDArray[np.uint8], parts: Sequence[Tile], *, gsd_m: float) -> Detections:
        """Vehicles in some parts of an image, in pixels of the image; one that two parts show counts once."""


def open_detector(
    path: Path | None = None,
    *,
    score: float = 0.3,
    providers: Sequence[str] | None = None,
    threads: int = 1,
    classes: Collection[str] | None = None,
    imgsz: int | None = None,
    per_class: bool = False,
    tiled: bool = True,
) -> Detector:
    """Load a detector.

    Args:
        path: an ONNX file; None = the bundled model.
        score: smallest score of a detection: raise → fewer false alarms, lower → fewer misses.
        providers: onnxruntime execution providers in order of preference; None = the CPU.
        classes: names of a YOLO model's classes that count; None = those that sound like vehicles.
        imgsz: longest side of the canvas, px, of a YOLO model that takes any; None = as its metadata has it, else 1024.
        per_class: True keeps a box for each class of a YOLO model that claims a vehicle; False one for each vehicle.
        tiled: a YOLO model is run on tiles of large images when vehicles would become too small; without ``gsd_m`` the
            vehicles themselves tell that.

    Raises:
        ModelError: no such file, not an ONNX model, not a shape that is known, or a provider that is not installed.
    """
    where = str(path or BUNDLED)
    chosen = tuple(providers or CPU)
    session = open_session(path or BUNDLED, chosen, threads)
    if "rollcall" not in metadata(session):
        return YoloDetector(session, where, score=score, classes=classes, imgsz=imgsz, per_class=per_class, tiled=tiled)
    if classes is not None or imgsz is not None:
        raise ModelError(f"{where}: classes and imgsz are for YOLO models; Rollcall's own finds vehicles of any size")
    if chosen != CPU:
        return HeatmapDetector(session, where, score=score, frame_px=np.inf)
    parts = open_session(BUNDLED_PARTS, CPU, threads) if path is None else None
    return HeatmapDetector(session, where, score=score, parts=parts)
