"""Labelled objects and detections by hand."""

import numpy as np

from vision.detect.detections import Detections
from vision.evaluation import Truth


def truth_of(boxes, *, counts=None, heading=None, name=None, hidden=None, upright=False):
    boxes = np.array(boxes, dtype=float).reshape(-1, 5)
    n = len(boxes)
    return Truth(
        boxes=boxes,
        heading=np.full(n, np.nan) if heading is None else np.array(heading, float),
        name=np.array(["car"] * n if name is None else name, dtype=np.str_),
        counts=np.ones(n, bool) if counts is None else np.array(counts, bool),
        hidden=np.full(n, -1) if hidden is None else np.array(hidden),
        upright=upright,
    )


def found_of(boxes, score, heading=None):
    cx, cy, w, h, angle = np.array(boxes, dtype=float).reshape(-1, 5).T
    heading = np.full(len(cx), np.nan) if heading is None else heading
    return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=np.array(score, float), heading=heading)
