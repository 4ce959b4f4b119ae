"""Boxes for a tracker, made by hand."""

from __future__ import annotations

import numpy as np

from vision.detect.detections import Detections

__all__ = ["STEP", "boxes"]

STEP = 100_000
"""Microseconds between two frames."""


def boxes(centre, angle=0.0, score=0.9, heading=np.nan, w=40.0, h=20.0):
    """Detections at centres (n, 2) px; everything else one number, or one a box."""
    centre = np.asarray(centre, dtype=float).reshape(-1, 2)
    columns = {"w": w, "h": h, "angle": angle, "score": score, "heading": heading}
    return Detections(
        cx=centre[:, 0], cy=centre[:, 1], **{k: np.broadcast_to(v, len(centre)) for k, v in columns.items()}
    )
