"""AprilTags on vehicle roofs: drawn into a rendered image, and read from an image by OpenCV.

A tag is a level plate at a vehicle's full height, its upper edge towards the front: the black square of the stated
side, and a white rim of an eighth of that side around it, as the family 36h11 wants it (10 × 10 modules in all).

Reference:
    Wang and Olson 2016, doi:10.1109/IROS.2016.7759617 (AprilTag 2, family 36h11).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.world.view import Bodies, CameraView, project

__all__ = ["Tag", "draw_tags", "read_image", "read_tags", "tag_corners"]

Image = NDArray[np.uint8]
FloatArray = NDArray[np.float64]

MODULES, RIM = 8, 1
"""Modules across the black square, and of the white rim on each side."""
INK, PAPER = 25.0, 235.0
"""Grey values of black and white print in daylight."""
OVERSAMPLING = 4
"""Tags are drawn at this multiple of the image's resolution and averaged down, as a sensor's pixel does."""
CROP_HALF_SIDE = 0.75
"""Half side of a crop, in lengths of the vehicle's box."""
MIN_PERIMETER_RATE = 0.15
"""OpenCV's minMarkerPerimeterRate: smallest perimeter over the crop's side, less than half that of a tag of 0.3 m."""
ENLARGED = 3
"""Factor by which a crop in which nothing is found is enlarged and searched again."""
LARGE_PX = 500
"""Crops larger than this are not enlarged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tag:
    """One tag on one body."""

    body: int
    """Index of the body in ``Bodies``."""
    number: int
    """Tag id within the family, 0 to 586."""
    side_m: float
    """Side of the black square."""


def tag_corners(bodies: Bodies, tag: Tag, side_m: float) -> FloatArray:
    """(4, 3) ENU corners of a square about a tag's middle: front left, front right, rear right, rear left."""
    i = tag.body
    forward = np.array([np.sin(bodies.heading[i]), np.cos(bodies.heading[i]), 0.0])
    right = np.array([forward[1], -forward[0], 0.0])
    middle = np.array([bodies.x[i], bodies.y[i], bodies.height[i]])
    half = 0.5 * side_m
    return np.stack([middle + half * (a * forward + b * right) for a, b in ((1, -1), (1, 1), (-1, 1), (-1, -1))])


def draw_tags(image: Image, view: CameraView, bodies: Bodies, tags: Sequence[Tag]) -> Image:
    """Draw tags into a copy of an image.

    Args:
        image: (H, W, 3) BGR, before the camera's blur and noise.
        view: the camera that made it.
        bodies: what it shows.
        tags: on some of the bodies; those not wholly in the image are left out.
    """
    done = image.copy()
    for tag in tags:
        plate, seen = project(view, tag_corners(bodies, tag, tag.side_m * (1.0 + 2.0 * RIM / MODULES)))
        if seen.all():
            _draw_tag(done, plate, tag.number)
    return done


def _draw_tag(image: Image, plate: FloatArray, number: int) -> None:
    """Draw a tag whose plate has these corners (4, 2) px, in place."""
    low = np.floor(plate.min(axis=0)).astype(int) - 1
    high = np.ceil(plate.max(axis=0)).astype(int) + 1
    if (low < 0).any() or (high > (image.shape[1], image.shape[0])).any():
        return
    part = image[low[1] : high[1], low[0] : high[0]]
    side = float(np.linalg.norm(plate[1] - plate[0]))
    paint = _plate_image(number, max(round(side * OVERSAMPLING / (MODULES + 2 * RIM)), 1))
    n = len(paint)
    # pixel centres lie at k + ½ on the sheet and in the oversampled image
    corners = np.array([[0.0, 0.0], [n, 0.0], [n, n], [0.0, n]]) - 0.5
    target = (plate - low) * OVERSAMPLING - 0.5
    warp = cv2.getPerspectiveTransform(corners.astype(np.float32), target.astype(np.float32))
    size = (part.shape[1] * OVERSAMPLING, part.shape[0] * OVERSAMPLING)
    paper = cv2.warpPerspective(paint, warp, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    cover = cv2.warpPerspective(np.ones((n, n), np.float32), warp, size, flags=cv2.INTER_NEAREST)
    ink, share = (cv2.resize(a, part.shape[1::-1], interpolation=cv2.INTER_AREA) for a in (paper * cover, cover))
    part[:] = np.clip(part * (1.0 - share[..., None]) + ink[..., None] + 0.5, 0, 255).astype(np.uint8)


@lru_cache(maxsize=256)
def _plate_image(number: int, module_px: int) -> NDArray[np.float32]:
    """(n, n) grey values of a plate with this many pixels a module."""
    mark = cv2.aruco.generateImageMarker(_family(), number, MODULES * module_px, borderBits=1)
    sheet = np.pad(mark, RIM * module_px, constant_values=255)
    return (INK + (PAPER - INK) * (sheet / np.float32(255.0))).astype(np.float32)


def _family() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@lru_cache(maxsize=2)
def _detector(min_perimeter_rate: float | None) -> cv2.aruco.ArucoDetector:
    settings = cv2.aruco.DetectorParameters()
    if min_perimeter_rate is not None:
        settings.minMarkerPerimeterRate = min_perimeter_rate
    return cv2.aruco.ArucoDetector(_family(), settings)


def read_image(image: Image) -> frozenset[int]:
    """Numbers of the tags that are read in a whole image (H, W, 3) BGR with OpenCV's own settings."""
    return _search(_grey(image), None)


def read_tags(image: Image, boxes: FloatArray) -> list[frozenset[int]]:
    """Numbers of the tags that can be read on each of some vehicles.

    Every vehicle is searched in a crop about its true position, enlarged if nothing is found: an upper bound for tag
    readers, which do not know where to look.

    Args:
        image: (H, W, 3) BGR.
        boxes: (n, 4) cx, cy, w, h px of the vehicles.
    """
    grey = _grey(image)
    return [_read(grey, box) for box in boxes]


def _read(grey: Image, box: FloatArray) -> frozenset[int]:
    reach = CROP_HALF_SIDE * float(max(box[2], box[3])) + 4.0
    x0, y0 = (max(int(c - reach), 0) for c in box[:2])
    x1, y1 = int(box[0] + reach) + 1, int(box[1] + reach) + 1
    crop = grey[y0:y1, x0:x1]
    if crop.size == 0:
        return frozenset()
    found = _search(crop, MIN_PERIMETER_RATE)
    if not found and max(crop.shape) <= LARGE_PX:
        large = cv2.resize(crop, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
        found = _search(np.asarray(large, np.uint8), MIN_PERIMETER_RATE)
    return found


def _grey(image: Image) -> Image:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _search(grey: Image, min_perimeter_rate: float | None) -> frozenset[int]:
    _, numbers, _ = _detector(min_perimeter_rate).detectMarkers(grey)
    return frozenset(() if numbers is None else map(int, numbers.ravel()))
