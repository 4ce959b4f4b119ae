"""Fit an image into a model's canvas and bring its boxes back, to sub-pixel. Continuous pixel coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.detect.boxes import wrap
from vision.detect.detections import Detections

GREY = 114
"""Value of the margins, the one that YOLO models are trained with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Letterbox:
    """Image → canvas: ``x' = x · scale_x + left``, ``y' = y · scale_y + top``, both from the image's edge.

    The two scales differ by less than a pixel over the side, as a scaled side is rounded to whole pixels.
    """

    width: int
    """Canvas, px."""
    height: int
    scale_x: float
    scale_y: float
    left: int
    """Left margin, px; where the margins differ by one, the smaller, as YOLO models are trained."""
    top: int

    @classmethod
    def fit(
        cls, image: tuple[int, int], canvas: tuple[int, int], *, most: float = np.inf, step: int | None = None
    ) -> Letterbox:
        """Centre an image on a canvas.

        Args:
            image: (width, height) px.
            canvas: (width, height) px.
            most: largest scale: a smaller image has wider margins.
            step: leave out margins by whole steps of this many px: the smallest canvas for a model that takes any
                multiple of its stride; None keeps the canvas.
        """
        (w, h), (width, height) = image, canvas
        if min(w, h, width, height) < 1:
            raise ValueError(f"a letterbox needs sides of 1 px or more, got {image} on {canvas}")
        scale = min(width / w, height / h, most)
        inner_w, inner_h = max(1, round(w * scale)), max(1, round(h * scale))
        if step is not None:
            width, height = inner_w + (width - inner_w) % step, inner_h + (height - inner_h) % step
        left, top = (width - inner_w) // 2, (height - inner_h) // 2
        return cls(width=width, height=height, scale_x=inner_w / w, scale_y=inner_h / h, left=left, top=top)

    def undo_points(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Canvas points (..., 2) in the image."""
        return (np.asarray(xy, dtype=np.float64) - (self.left, self.top)) / (self.scale_x, self.scale_y)

    def undo_boxes(self, boxes: ArrayLike) -> NDArray[np.float64]:
        """Canvas boxes (..., 5) in the image."""
        rows = np.array(boxes, dtype=np.float64)
        rows[..., :2] = self.undo_points(rows[..., :2])
        rows[..., 2:4] /= np.sqrt(self.scale_x * self.scale_y)
        return rows


def letterbox(image: NDArray[np.uint8], canvas: tuple[int, int]) -> tuple[NDArray[np.uint8], Letterbox]:
    """Scale an image (H, W, 3) onto a grey canvas (width, height), keeping its shape.

    Returns:
        The canvas (height, width, 3) and the map that brings boxes back.
    """
    fit = Letterbox.fit((image.shape[1], image.shape[0]), canvas)
    return draw(image, fit, average=fit.scale_x < 0.5), fit


def draw(image: NDArray[np.uint8], fit: Letterbox, *, average: bool) -> NDArray[np.uint8]:
    """An image (H, W, 3) on its grey canvas (height, width, 3).

    Args:
        image: the image that ``fit`` was made for.
        fit: where it goes.
        average: a pixel is the mean of those it covers, which keeps what is small when an image is shrunk far; else it
            is interpolated between four, as YOLO models are trained.
    """
    size = (round(image.shape[1] * fit.scale_x), round(image.shape[0] * fit.scale_y))
    inner = image
    if size != (image.shape[1], image.shape[0]):
        how = cv2.INTER_AREA if average else cv2.INTER_LINEAR
        inner = np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)
    out = np.full((fit.height, fit.width, *image.shape[2:]), GREY, dtype=np.uint8)
    out[fit.top : fit.top + size[1], fit.left : fit.left + size[0]] = inner
    return out


def undo(found: Detections, fit: Letterbox, image: NDArray[np.uint8]) -> Detections:
    """Bring detections from the canvas to the image (H, W, 3); boxes centred on the margins are dropped."""
    height, width = image.shape[:2]
    boxes = fit.undo_boxes(found.boxes)
    cx, cy, w, h, _ = boxes.T
    in_image = replace(found, cx=cx, cy=cy, w=w, h=h, angle=wrap(found.angle))
    return in_image.select((cx >= 0.0) & (cx <= width) & (cy >= 0.0) & (cy <= height))
