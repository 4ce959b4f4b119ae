"""Camera motion from the pixels: corners all over the image are followed into the next one, most of them lie on the
ground, and one homography explains those.

Vehicles do not disturb: corners in their boxes are not used, and those that are missed move in other ways than most
(outliers). Nor does text that is drawn on the image: a corner is taken in each cell of a grid, however strong those in
others are, so that text has few of them; where it has more than the ground, ground that moves wins over text that
stands still.

References:
    J. Shi, C. Tomasi, "Good Features to Track", CVPR 1994, doi:10.1109/CVPR.1994.323794.
    J.-Y. Bouguet, "Pyramidal Implementation of the Lucas Kanade Feature Tracker", Intel, 2001.
    D. Barath et al., "MAGSAC++, a Fast, Reliable and Accurate Robust Estimator", CVPR 2020,
    doi:10.1109/CVPR42600.2020.00138.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion
from vision.motion.plane_fit import fit_plane

Image = NDArray[np.uint8]
Points = NDArray[np.float32]

MAX_PIXELS = 260_000
"""An image is halved until it has no more: 1920×1080 becomes 480×270, 1280×720 becomes 640×360."""
MIN_SIDE = 64
"""Height and width of an image that can be compared at all, px."""
MEAN_GREY, GREY_STD, MAX_GAIN = 128.0, 45.0, 4.0
"""Brightness and contrast that every image is brought to, so that a change of exposure is no motion."""
CELLS = 150
"""Cells of the grid, about: one corner each."""
CORNER_BLOCK = 5
"""Side of the square by whose gradients a corner is found, px of half the small picture."""
MIN_CORNER = 2e-5
"""Smaller eigenvalue of the gradients' covariance below which there is nothing to follow: sensor noise has a tenth."""
WINDOW, LEVELS = 9, 3
"""Side of the square that is followed, small px, and halvings for large motions: these reach 40 small px."""
STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.03)
"""Steps of the search on each level at most, and the step, small px, after which it ends."""
STILL_PX = 0.25
"""A point that moved less may be drawn on the image, small px."""
MAX_JITTER = 0.2
"""Share of points on something that stands still that seem to move all the same."""
MIN_SHARE = 0.3
"""Minimum share of all points that could be followed; of a cut a tenth follows some homography or other."""
MIN_MOVING_SHARE = 0.2
"""Share of all points, when most stand still: this many that move as one are the ground, and not a vehicle or two."""
BOX_MARGIN = 1.5
"""Boxes are taken this much larger: shadows, and the squares that are followed, reach beyond them."""


class MotionEstimator:
    """Compares each image with the one before.

    Example:
        >>> ground = np.random.default_rng(1).integers(0, 255, (60, 80, 3), dtype=np.uint8)
        >>> ground = cv2.resize(ground, (640, 480), interpolation=cv2.INTER_CUBIC)
        >>> estimator = MotionEstimator()
        >>> estimator.update(ground) is None
        True
        >>> motion = estimator.update(np.roll(ground, (-8, 12), axis=(0, 1)))
        >>> motion.H[:2, 2].round().tolist()
        [12.0, -8.0]
    """

    def __init__(self) -> None:
        self._small: Image = np.empty((0, 0), np.uint8)
        self._size = (0, 0)
        self._corners: Points = np.empty((0, 2), np.float32)

    def update(self, image: Image, boxes: Detections | None = None) -> ImageMotion | None:
        """Motion since the image of the last call.

        Args:
            image: (H, W, 3) BGR.
            boxes: vehicles in it, px.

        Returns:
            None where it cannot be told: the first image, one of another size, a cut, nothing to follow.
        """
        size = image.shape[:2]
        if min(size) < MIN_SIDE:
            self._size = (0, 0)
            return None
        before, corners, comparable = self._small, self._corners, size == self._size
        self._size = (0, 0)
        self._small, halvings = _reduced(image)
        self._corners = _find_corners(self._small, boxes, 0.5**halvings)
        # only now: what follows an image that could not be worked on has nothing to be compared with
        self._size = size
        return _compare(before, self._small, corners, 2.0**halvings) if comparable and len(corners) else None


def _reduced(image: Image) -> tuple[Image, int]:
    """A small grey picture (h, w) of normal brightness and contrast, and how often the image was halved for it.

    By exact halves, which are several times quicker than any other scale.
    """
    small, halvings = image, 0
    while small.shape[0] * small.shape[1] > MAX_PIXELS:
        small = _grey(_halved(small))
        halvings += 1
    small = _grey(small)
    mean, std = cv2.meanStdDev(small)
    gain = min(GREY_STD / max(float(std[0, 0]), 1e-3), MAX_GAIN)
    levels = np.clip((np.arange(256) - float(mean[0, 0])) * gain + MEAN_GREY, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(small, levels), np.uint8), halvings


def _halved(image: Image) -> Image:
    height, width = image.shape[0] // 2, image.shape[1] // 2
    half = cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(half, np.uint8)


def _grey(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8) if image.ndim == 3 else image


def _find_corners(small: Image, boxes: Detections | None, scale: float) -> Points:
    """The strongest corner (k, 2) in each cell of a grid, where there is one outside of the boxes."""
    # at half the size, for a quarter of the time: what is followed need not be the very corner
    strength = np.asarray(cv2.cornerMinEigenVal(_halved(small), CORNER_BLOCK))
    height, width = strength.shape
    for outline in () if boxes is None else _outlines(boxes, 0.5 * scale):
        cv2.fillConvexPoly(strength, outline, (0.0,))
    # the filters' border is made up
    edge = CORNER_BLOCK // 2 + 1
    strength[:edge], strength[-edge:], strength[:, :edge], strength[:, -edge:] = 0.0, 0.0, 0.0, 0.0
    cell = max(int(np.sqrt(height * width / CELLS)), 1)
    rows, columns = height // cell, width // cell
    squares = strength[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).swapaxes(1, 2)
    cells = squares.reshape(rows * columns, cell * cell)
    best = cells.argmax(axis=1)
    kept = np.flatnonzero(cells[np.arange(len(cells)), best] > MIN_CORNER)
    x = kept % columns * cell + best[kept] % cell
    y = kept // columns * cell + best[kept] // cell
    return 2.0 * np.stack([x, y], axis=1).astype(np.float32) + np.float32(0.5)


def _outlines(boxes: Detections, scale: float) -> NDArray[np.int32]:
    """Corners (m, 4, 2) of the boxes with their margin, small px."""
    outlines = boxes.centre[:, None] + BOX_MARGIN * (boxes.corners() - boxes.centre[:, None])
    return np.ascontiguousarray(np.clip(np.rint(scale * outlines), -1e4, 1e4), dtype=np.int32)


def _compare(before: Image, small: Image, corners: Points, scale: float) -> ImageMotion | None:
    """Follow corners (k, 2) of one small picture into the next, each pixel of which is ``scale`` of the image's."""
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        before, small, corners, corners.copy(), winSize=(WINDOW, WINDOW), maxLevel=LEVELS, criteria=STOP
    )
    followed = np.asarray(status).ravel() > 0
    # OpenCV's pixels have whole numbers in their middle, ours at their edge
    a, b = (np.asarray(points, dtype=np.float64)[followed] + 0.5 for points in (corners, found))
    size = (small.shape[1], small.shape[0])
    fit = fit_plane(a, b, size, round(MIN_SHARE * len(a)))
    moved = np.linalg.norm(b - a, axis=1) > STILL_PX
    if fit is None or np.count_nonzero(moved & fit.inliers) < MAX_JITTER * np.count_nonzero(fit.inliers):
        ground = fit_plane(a[moved], b[moved], size, round(MIN_MOVING_SHARE * len(a)))
        fit = fit if ground is None else ground
    if fit is None:
        return None
    S = np.diag([scale, scale, 1.0])
    count = int(np.count_nonzero(fit.inliers))
    return ImageMotion(H=S @ fit.H @ np.linalg.inv(S), std_px=scale * fit.std, inliers=count, share=count / len(a))
