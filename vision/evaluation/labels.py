"""Label files of one image: YOLO (oriented or upright), DOTA, VisDrone-DET.

    YOLO       class x1 y1 x2 y2 x3 y3 x4 y4, or class cx cy w h (upright); shares of the image's sides
    DOTA       x1 y1 x2 y2 x3 y3 x4 y4 category difficult, px; header lines ``imagesource:…`` and ``gsd:…``
    VisDrone   left,top,width,height,score,category,truncation,occlusion, px

A quadrangle becomes the smallest rectangle around it, as oriented detectors are trained on.

References:
    Xia et al. 2018, arXiv:1711.10398 (DOTA); Zhu et al. 2021, arXiv:2001.06303 (VisDrone).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from infra.files.safe_open import read_small
from infra.text_numbers import number
from vision.errors import LabelError
from vision.evaluation.truth import REGION, Truth

Floats = NDArray[np.float64]
MAX_BYTES = 64 << 20
"""Maximum bytes of the labels of one image."""
Row = tuple[Floats, float, str, bool, int]
"""Box (5,), heading, class, whether it counts, how hidden it is."""

VISDRONE = (
    REGION,
    "pedestrian",
    "people",
    "bicycle",
    "car",
    "van",
    "truck",
    "tricycle",
    "awning-tricycle",
    "bus",
    "motor",
    "others",
)
"""Category names, in order."""
_MIN_PX = 1e-3
BEYOND = 0.5
"""Largest distance beyond the image of a corner of a normalised label, shares of its sides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelFile:
    """Content of a label file."""

    truth: Truth
    gsd_m: float = math.nan
    """Metres per pixel, NaN where it is not given."""
    without_area: int = 0
    """Boxes without height or width, which were left out: some are in most large sets."""


def read_yolo(path: Path, size: tuple[int, int], names: Mapping[int, str], corners_tell_front: bool) -> LabelFile:
    """YOLO labels.

    Args:
        size: width and height of the image, px.
        names: of the classes; a class without one is called by its number.
        corners_tell_front: the first two corners are those of the front.

    Raises:
        LabelError: a line that makes no sense.
    """
    upright: set[bool] = set()

    def row(fields: list[str], where: str) -> Row:
        if len(fields) not in (5, 9):
            raise LabelError(f"{where}: {len(fields)} values, wanted 9 (class and four corners) or 5 (class cx cy w h)")
        number, *shares = _numbers(fields, where)
        if number != int(number) or number < 0:
            raise LabelError(f"{where}: class {fields[0][:60]!r} is no class number; wanted 0, 1, …")
        if min(shares) < -BEYOND or max(shares) > 1.0 + BEYOND:
            raise LabelError(f"{where}: coordinates reach {max(shares, key=abs):g}, wanted shares of the sides, 0 to 1")
        upright.add(len(fields) == 5)
        name = names.get(int(number), str(int(number)))
        if len(fields) == 5:
            return _upright(np.array(shares) * (*size, *size)), math.nan, name, True, -1
        box, heading = _rectangle(np.array(shares).reshape(4, 2) * size, corners_tell_front)
        return box, heading, name, True, -1

    rows = _rows(path, row, None)
    if len(upright) > 1:
        raise LabelError(f"{path}: lines of 9 and of 5 values; oriented and upright boxes cannot be judged together")
    return _label_file(rows, upright == {True})


def read_dota(path: Path, corners_tell_front: bool) -> LabelFile:
    """DOTA labels; difficult objects count neither way.

    Args:
        corners_tell_front: the first two corners are those of the front.

    Raises:
        LabelError: a line that makes no sense.
    """
    gsd = math.nan

    def row(fields: list[str], where: str) -> Row | None:
        nonlocal gsd
        key, _, value = fields[0].partition(":")
        if key.lower() in ("imagesource", "gsd"):
            gsd = _gsd(value, where) if key.lower() == "gsd" else gsd
            return None
        if len(fields) not in (9, 10):
            raise LabelError(f"{where}: {len(fields)} values, wanted x1 y1 x2 y2 x3 y3 x4 y4 category difficult")
        if len(fields) == 10 and fields[9] not in ("0", "1", "2"):
            raise LabelError(f"{where}: difficult is {fields[9][:60]!r}, wanted 0 or 1")
        points = np.array(_numbers(fields[:8], where)).reshape(4, 2)
        box, heading = _rectangle(points, corners_tell_front)
        return box, heading, fields[8], len(fields) == 9 or fields[9] == "0", -1

    rows = _rows(path, row, None)
    return _label_file(rows, False, gsd)


def read_visdrone(path: Path) -> LabelFile:
    """VisDrone-DET annotations; objects of score 0 and ignored regions count neither way.

    Raises:
        LabelError: a line that makes no sense.
    """

    def row(fields: list[str], where: str) -> Row:
        if len(fields) < 8:
            raise LabelError(
                f"{where}: {len(fields)} values, wanted left,top,width,height,score,category,truncation,occlusion"
            )
        left, top, width, height, score, category, _, occlusion = _numbers(fields[:8], where)
        if category not in range(len(VISDRONE)):
            raise LabelError(f"{where}: category {fields[5][:60]} is none; there are 0 to {len(VISDRONE) - 1}")
        if occlusion not in (0, 1, 2):
            raise LabelError(f"{where}: occlusion {fields[7][:60]} is none; there are 0, 1 and 2")
        box = _upright(np.array([left + width / 2.0, top + height / 2.0, width, height]))
        return box, math.nan, VISDRONE[int(category)], score > 0 and category > 0, int(occlusion)

    return _label_file(_rows(path, row, ","), True)


def read_text(path: Path) -> str:
    """The text of a file of labels.

    Raises:
        LabelError: it cannot be read, or is not UTF-8.
    """
    try:
        return read_small(path, MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise LabelError(f"{path}: cannot be read as text: {error}; save it as UTF-8") from error


def _rows(path: Path, row: Callable[[list[str], str], Row | None], separator: str | None) -> list[Row]:
    lines = read_text(path).splitlines()
    rows = ((i, line.strip().rstrip(",")) for i, line in enumerate(lines, 1))
    made = (row(line.split(separator), f"{path}, line {i}") for i, line in rows if line)
    return [one for one in made if one is not None]


def _numbers(fields: Sequence[str], where: str) -> list[float]:
    values = []
    for field in fields:
        try:
            values.append(number(field))
        except ValueError as error:
            raise LabelError(f"{where}: {error}") from None
    return values


def _gsd(value: str, where: str) -> float:
    if value.lower() in ("", "null", "none", "nan"):
        return math.nan
    (gsd,) = _numbers([value], where)
    if gsd <= 0.0:
        raise LabelError(f"{where}: gsd is {gsd:g}, wanted metres per pixel above 0")
    return gsd


def _upright(centre_size: Floats) -> Floats:
    return np.append(centre_size, 0.0)


def _rectangle(points: Floats, corners_tell_front: bool) -> tuple[Floats, float]:
    """The smallest rectangle (5,) around corners (4, 2), and the heading of the side between the first two."""
    # about their own middle: OpenCV counts in 32 bits
    middle = points.mean(axis=0)
    (dx, dy), (w, h), degrees = cv2.minAreaRect((points - middle).astype(np.float32))
    if not corners_tell_front:
        return np.array([middle[0] + dx, middle[1] + dy, w, h, math.radians(degrees)]), math.nan
    ahead = 0.5 * (points[0] + points[1]) - middle
    # heading: clockwise from image up, x right and y down
    heading = math.atan2(ahead[0], -ahead[1]) % (2.0 * math.pi)
    return np.array([middle[0] + dx, middle[1] + dy, w, h, math.radians(degrees)]), heading


def _label_file(rows: Sequence[Row], upright: bool, gsd_m: float = math.nan) -> LabelFile:
    """Label file of the boxes that have an area."""
    kept = [row for row in rows if min(row[0][2:4]) > _MIN_PX]
    return LabelFile(truth=_truth(kept, upright), gsd_m=gsd_m, without_area=len(rows) - len(kept))


def _truth(rows: Sequence[Row], upright: bool) -> Truth:
    return Truth(
        boxes=np.array([r[0] for r in rows], dtype=np.float64).reshape(-1, 5),
        heading=np.array([r[1] for r in rows], dtype=np.float64),
        name=np.array([r[2] for r in rows], dtype=np.str_),
        counts=np.array([r[3] for r in rows], dtype=bool),
        hidden=np.array([r[4] for r in rows], dtype=np.int64),
        upright=upright,
    )
