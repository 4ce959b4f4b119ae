"""Fields of view of cameras by their names, where their makers publish them, and of equivalent focal lengths.

An equivalent focal length compares diagonals with that of 36 × 24 mm, 43.27 mm. Film takes the whole width of sensors
of 4 : 3 and cuts them above and below:

    tan(hfov / 2) = (4 / 5) (43.27 mm / 2) / f

so that 24 mm, which DJI gives as a field of view of 84° across the diagonal, are 71.6° across the picture.

What is not in the table is unknown: radio links such as Herelink, whose cameras are anybody's; bare sensors, whose
lenses are; and lenses so wide that a field of view does not describe them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_DIAGONAL_MM = math.hypot(36.0, 24.0)
_WIDTH_OF_DIAGONAL = 4.0 / 5.0


def from_focal_length(equivalent_mm: Floats) -> Floats:
    """Horizontal field of view in radians of equivalent focal lengths (n,) in mm."""
    return np.asarray(2.0 * np.arctan(_WIDTH_OF_DIAGONAL * 0.5 * _DIAGONAL_MM / equivalent_mm))


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraModel:
    """A camera whose maker publishes its field of view."""

    name: str
    hfov_deg: float
    """Horizontal, of its video at the widest."""
    source: str
    also: tuple[str, ...] = ()
    """Other names that it goes by in messages."""
    zoom_max: float = 1.0
    """Magnification at 100 % of the zoom that ArduPilot reports in CAMERA_SETTINGS; 1: it does not zoom."""
    cropped: tuple[int, int] = (0, 0)
    """Size of a video, px, that may show less than the whole width of the sensor."""

    def shows_all(self, width: int, height: int) -> bool:
        """Tell whether a video of this size, px, is known to have this field of view; 0: its size is not known."""
        return not any(self.cropped) or (width > 0 and (width, height) != self.cropped)


def _of_diagonal(name: str, equivalent_mm: float) -> CameraModel:
    hfov = math.degrees(float(from_focal_length(np.array([equivalent_mm]))[0]))
    return CameraModel(
        name=name, hfov_deg=hfov, source=f"its maker's data sheet: {equivalent_mm:g} mm equivalent, 4:3 sensor"
    )


def _raspberry_pi(version: str, hfov_deg: float, cropped: tuple[int, int] = (0, 0)) -> CameraModel:
    return CameraModel(
        name=f"raspberry-pi-camera-module-{version}",
        hfov_deg=hfov_deg,
        source="Raspberry Pi's documentation, horizontal field of view of the whole sensor",
        also=(f"Raspberry Pi Camera Module v{version}",),
        cropped=cropped,
    )


_DATA_SHEET = CameraModel(name="", hfov_deg=math.nan, source="its maker's data sheet, horizontal field of view")
_KNOWN = (
    *(
        _of_diagonal(name, 24.0)
        for name in (
            "dji-mavic-mini",
            "dji-mini-se",
            "dji-mini-2",
            "dji-mini-2-se",
            "dji-mini-3",
            "dji-mini-3-pro",
            "dji-mini-4-pro",
            "dji-mavic-air-2",
            "dji-air-3",
            "dji-air-3s",
            "dji-mavic-3",
            "dji-mavic-3-classic",
            "dji-mavic-3-pro",
            "dji-m30",
            "dji-m30t",
            "dji-m3e",
            "dji-m3t",
        )
    ),
    replace(_DATA_SHEET, name="siyi-a8-mini", hfov_deg=81.0, also=("Siyi A8",), zoom_max=6.0),
    replace(_DATA_SHEET, name="siyi-zr10", hfov_deg=62.0, source=f"{_DATA_SHEET.source} at the widest", zoom_max=30.0),
    CameraModel(name="siyi-mt11", hfov_deg=88.0, source="AP_CameraGimbal's documentation, nominal wide field of view"),
    # of their sensors' middle alone film in 1920 × 1080 is made
    _raspberry_pi("1", 53.5, (1920, 1080)),
    _raspberry_pi("2", 62.2, (1920, 1080)),
    _raspberry_pi("3", 66.0),
    _raspberry_pi("3-wide", 102.0),
)
CAMERAS: dict[str, CameraModel] = {camera.name: camera for camera in _KNOWN}
"""Cameras by name."""
_BY_LETTERS = {"".join(filter(str.isalnum, name.lower())): each for each in _KNOWN for name in (each.name, *each.also)}


def camera_model(*words: str) -> CameraModel | None:
    """A known camera by its name, perhaps its maker's before it; None for others.

    Case, spaces and hyphens do not matter, nor a maker that the name has too: ``DJI Mini3Pro`` is one, and so is
    ``Siyi`` with ``SIYI A8 mini``.
    """
    for name in (" ".join(words), words[-1]):
        if known := _BY_LETTERS.get("".join(filter(str.isalnum, name.lower()))):
            return known
    return None
