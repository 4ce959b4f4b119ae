"""Fields of view: of an equivalent focal length, and of known cameras.

An equivalent focal length compares diagonals with that of 36 × 24 mm, 43.27 mm. Film takes the whole width of sensors
of 4 : 3 and cuts them above and below:

    tan(hfov / 2) = (4 / 5) (43.27 mm / 2) / f

so that 24 mm, which DJI gives as a field of view of 84° across the diagonal, are 71.6° across the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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


def _of_diagonal(name: str, equivalent_mm: float) -> CameraModel:
    hfov = math.degrees(float(from_focal_length(np.array([equivalent_mm]))[0]))
    return CameraModel(
        name=name, hfov_deg=hfov, source=f"its maker's data sheet: {equivalent_mm:g} mm equivalent, 4:3 sensor"
    )


_KNOWN = (
    *(
        _of_diagonal(name, 24.0)
        for name in (
            "dji-mavic-mini",
            "dji-mini-2",
            "dji-mini-3",
            "dji-mini-3-pro",
            "dji-mini-4-pro",
            "dji-mavic-air-2",
            "dji-air-3",
            "dji-mavic-3",
            "dji-m30",
            "dji-m3e",
        )
    ),
    CameraModel(name="siyi-a8-mini", hfov_deg=81.0, source="its maker's data sheet, horizontal field of view"),
    CameraModel(
        name="siyi-zr10", hfov_deg=62.0, source="its maker's data sheet, horizontal field of view at the widest"
    ),
    CameraModel(name="siyi-mt11", hfov_deg=88.0, source="AP_CameraGimbal's documentation, nominal wide field of view"),
)
CAMERAS: dict[str, CameraModel] = {camera.name: camera for camera in _KNOWN}
"""Cameras by the name that ``--camera`` takes."""


def camera_model(name: str) -> CameraModel | None:
    """A known camera, None for others; case, spaces and hyphens do not matter: ``DJI Mini3Pro`` is one."""
    wanted = _letters(name)
    return next((camera for camera in _KNOWN if _letters(camera.name) == wanted), None)


def _letters(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())
