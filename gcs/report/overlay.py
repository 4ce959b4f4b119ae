"""Draw a snapshot on its image: oriented boxes, front marks, names, a header. Pure.

Units and frames: image pixels, x right, y down; angles clockwise on screen in radians; colours are red, green, blue
here and turned to OpenCV's order only where OpenCV draws.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.certainty import certainty
from gcs.snapshot import Box, Snapshot, Standing

__all__ = [
    "DARK",
    "STANDING_RGB",
    "box_bounds",
    "box_corners",
    "draw",
    "drawable",
    "front_mark",
    "is_picked",
    "label_of",
    "named_count",
    "place_labels",
    "standing_of",
]

Rgb = tuple[int, int, int]
Rect = tuple[float, float, float, float]
"""Left, top, width, height."""

STANDING_RGB: Final[Mapping[Standing, Rgb]] = MappingProxyType(
    {
        "confirmed": (140, 240, 120),
        "tentative": (226, 176, 10),
        "coasting": (104, 158, 245),
        "unidentified": (246, 184, 255),
        "out of view": (163, 171, 187),
        "no position": (240, 112, 96),
        "no new frame": (233, 236, 240),
    }
)
"""Far enough apart to be told from each other without red, green or blue cones, and bright enough on the dark."""
DARK: Final[Rgb] = (14, 18, 26)
"""Behind labels and where there is no image."""
FAR_MS: Final = 250_000_000_000_000
HEADER_INK: Final = (214, 222, 235)
FARTHEST_PX: Final = 30_000.0
"""OpenCV counts in 16 bits before the point when it smooths lines."""
EMPTY_SIZE: Final = (1280, 720)
FONT: Final = cv2.FONT_HERSHEY_SIMPLEX


def standing_of(snapshot: Snapshot, box: Box) -> Standing:
    """How sure the station is of a box, in the same words as the fleet table."""
    if box.coasting:
        return "coasting"
    if not box.system_id:
        return "unidentified"
    for row in snapshot.vehicles:
        if row.system_id == box.system_id and row.standing in ("confirmed", "tentative"):
            return row.standing
    return "tentative"


def label_of(snapshot: Snapshot, box: Box) -> str:
    """``UGV-3 97%`` confirmed, ``UGV-3? 61%`` tentative, ``~UGV-3 88%`` coasting, ``?`` unidentified, ``~?`` both,
    ``UGV-3 stated`` by the operator; ``UGV-3 97% (0.8s)`` is held, for want of a newer frame."""
    standing = standing_of(snapshot, box)
    name = snapshot.name_of(box.system_id) if box.system_id else "?"
    sure = f" {'stated' if box.stated else certainty(box.confidence)}".rstrip() if box.system_id else ""
    before = "~" if standing == "coasting" else ""
    after = "?" if standing == "tentative" and not box.stated else ""
    held = f" ({snapshot.held_s:.1f}s)" if snapshot.held_s else ""
    return f"{before}{name}{after}{sure}{held}"


def named_count(snapshot: Snapshot) -> tuple[int, int]:
    """Confirmed ground vehicles and all ground vehicles."""
    standings = [row.standing for row in snapshot.vehicles if row.role == "ugv"]
    return standings.count("confirmed"), len(standings)


def is_picked(box: Box, selected: int, track: int) -> bool:
    """Whether a box is of the picked vehicle, or is the picked box without a name; 0 none."""
    return bool(selected and box.system_id == selected) or bool(track and box.track_id == track)


def drawable(box: Box) -> bool:
    """Whether a box has a place and a size that can be drawn."""
    numbers = (box.cx, box.cy, box.w, box.h, box.angle)
    return box.w > 0 and box.h > 0 and all(abs(number) < FARTHEST_PX for number in numbers)


def box_corners(box: Box) -> NDArray[np.float64]:
    """(4, 2) pixel corners of an oriented box, clockwise from its own top left."""
    c, s = math.cos(box.angle), math.sin(box.angle)
    # p = c + R(angle) · (±w/2, ±h/2)
    half = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * (box.w, box.h)
    return np.asarray(half @ np.array([(c, s), (-s, c)]) + (box.cx, box.cy), dtype=np.float64)


def front_mark(box: Box, reach: float = 0.45) -> NDArray[np.float64]:
    """(2, 2) pixel ends of the tick ahead of the front edge, NaN when the front is unknown.

    Args:
        box: Its heading is clockwise from image up.
        reach: Length of the tick in lengths of the box.
    """
    if not math.isfinite(box.heading):
        return np.full((2, 2), math.nan)
    # d = (sin heading, −cos heading): clockwise from image up, y down
    direction = np.array([math.sin(box.heading), -math.cos(box.heading)])
    along = abs(math.cos(box.angle) * direction[0] + math.sin(box.angle) * direction[1])
    length = box.w * along + box.h * (1.0 - along)
    edge = np.array([box.cx, box.cy]) + direction * length / 2
    return np.stack([edge, edge + direction * length * reach])


def box_bounds(box: Box, scale: float = 1.0, margin: float = 0.0) -> Rect:
    """Upright rectangle round a scaled box and its front tick."""
    points = np.vstack([box_corners(box), front_mark(box)]) * scale
    (left, top), (right, bottom) = np.nanmin(points, axis=0) - margin, np.nanmax(points, axis=0) + margin
    return float(left), float(top), float(right - left), float(bottom - top)


def place_labels(anchors: Sequence[Rect], sizes: Sequence[tuple[float, float]], bounds: Rect) -> list[Rect]:
    """Put each label beside its box so that labels cover neither each other nor other boxes where that is easy.

    Args:
        anchors: Upright bounding rectangle of each box; earlier ones choose first.
        sizes: Width and height of each label, in the same units.
        bounds: Rectangle that labels must not leave.

    Returns:
        One rectangle per label: the least covered of eight places round its box.
    """
    boxes = np.array(anchors, dtype=np.float64).reshape(-1, 4)
    placed = np.zeros_like(boxes)
    for index, (anchor, size) in enumerate(zip(anchors, sizes, strict=True)):
        spots = np.array([_clamp(spot, bounds) for spot in _spots(anchor, size)])
        weight = np.full(len(boxes), 3.0)
        weight[index] = 2.0
        covered = 4.0 * _overlaps(spots, placed[:index]).sum(axis=1) + _overlaps(spots, boxes) @ weight
        placed[index] = spots[int(np.argmin(covered))]
    return [(x, y, w, h) for x, y, w, h in placed.tolist()]


def _spots(anchor: Rect, size: tuple[float, float]) -> list[Rect]:
    x, y, w, h = anchor
    lw, lh = size
    middle, centre = x + (w - lw) / 2, y + (h - lh) / 2
    corners = [(middle, y - lh), (middle, y + h), (x + w, centre), (x - lw, centre)]
    corners += [(x + w, y - lh), (x - lw, y - lh), (x + w, y + h), (x - lw, y + h)]
    return [(left, top, lw, lh) for left, top in corners]


def _clamp(rect: Rect, bounds: Rect) -> Rect:
    x, y, w, h = rect
    left, top, width, height = bounds
    return max(left, min(x, left + width - w)), max(top, min(y, top + height - h)), w, h


def _overlaps(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, k) area that each of m rectangles has in common with each of k, as rows x, y, w, h."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    return np.asarray(np.prod(np.maximum(high - low, 0.0), axis=-1), dtype=np.float64)


def draw(snapshot: Snapshot, *, scale: float = 1.0, selected: int = 0, track: int = 0) -> NDArray[np.uint8]:
    """The image with boxes, front ticks, names and a header with time and fleet summary.

    Args:
        snapshot: Its image is left as it is; without one the canvas is dark.
        scale: Size of the result against the image, above 0.
        selected: System id to stress, 0 none.
        track: Track id of a box without a name to stress, 0 none.

    Returns:
        (round(height · scale), round(width · scale), 3) uint8 BGR.
    """
    canvas = _canvas(snapshot, scale)
    unit = max(0.75, canvas.shape[0] / 900)
    boxes = sorted(
        filter(drawable, snapshot.boxes),
        key=lambda box: (not is_picked(box, selected, track), box.system_id == 0, -box.cy),
    )
    labels = [_ascii(label_of(snapshot, box)) for box in boxes]
    sizes = [_text_size(text, unit) for text in labels]
    anchors = [box_bounds(box, scale, 2 * unit) for box in boxes]
    places = place_labels(anchors, sizes, (0, 0, canvas.shape[1], canvas.shape[0]))
    for box in boxes:
        _draw_box(canvas, box, STANDING_RGB[standing_of(snapshot, box)], scale, unit)
    for box, text, place in zip(boxes, labels, places, strict=True):
        colour = STANDING_RGB[standing_of(snapshot, box)]
        highlighted = is_picked(box, selected, track)
        _draw_label(canvas, text, place, unit, *((DARK, colour) if highlighted else (colour, DARK)))
    _draw_header(canvas, snapshot, unit)
    return canvas


def _canvas(snapshot: Snapshot, scale: float) -> NDArray[np.uint8]:
    width, height = (snapshot.width, snapshot.height) if snapshot.width and snapshot.height else EMPTY_SIZE
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if snapshot.image is None:
        return np.full((size[1], size[0], 3), DARK[::-1], dtype=np.uint8)
    if snapshot.image.shape[1::-1] == size:
        return snapshot.image.copy()
    return np.asarray(cv2.resize(snapshot.image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _draw_box(canvas: NDArray[np.uint8], box: Box, rgb: Rgb, scale: float, unit: float) -> None:
    outline = np.round(box_corners(box) * scale).astype(np.int32)
    thick = max(1, round(1.6 * unit))
    cv2.polylines(canvas, [outline], True, DARK[::-1], thick + 2, cv2.LINE_AA)
    cv2.polylines(canvas, [outline], True, rgb[::-1], 1 if box.coasting else thick, cv2.LINE_AA)
    tick = front_mark(box) * scale
    if np.isfinite(tick).all():
        start, end = np.round(tick).astype(int).tolist()
        cv2.line(canvas, start, end, DARK[::-1], thick + 3, cv2.LINE_AA)
        cv2.line(canvas, start, end, rgb[::-1], thick + 1, cv2.LINE_AA)


def _text_size(text: str, unit: float) -> tuple[float, float]:
    (width, height), base = cv2.getTextSize(text, FONT, 0.55 * unit, max(1, round(unit)))
    return float(width + 8 * unit), float(height + base + 4 * unit)


def _draw_label(canvas: NDArray[np.uint8], text: str, place: Rect, unit: float, ink: Rgb, paper: Rgb) -> None:
    x, y, w, h = (round(value) for value in place)
    cv2.rectangle(canvas, (x, y), (x + w, y + h), paper[::-1], cv2.FILLED)
    origin = x + round(4 * unit), y + h - round(5 * unit)
    cv2.putText(canvas, text, origin, FONT, 0.55 * unit, ink[::-1], max(1, round(unit)), cv2.LINE_AA)


def _draw_header(canvas: NDArray[np.uint8], snapshot: Snapshot, unit: float) -> None:
    # counted from the epoch, since the platform's clock functions refuse far times
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=snapshot.now_us // 100_000 * 100 % FAR_MS)
    clock = moment.strftime("%Y-%m-%d %H:%M:%S.%f")[:-5]
    named, total = named_count(snapshot)
    unnamed = sum(box.system_id == 0 for box in snapshot.boxes)
    text = f"{clock}Z   frame {snapshot.frame}   {named}/{total} confirmed" + (f"   {unnamed} ?" if unnamed else "")
    width, height = _text_size(text, unit)
    _draw_label(canvas, text, (0.0, 0.0, width, height), unit, HEADER_INK, DARK)


def _ascii(text: str) -> str:
    """OpenCV's fonts hold printable ASCII only."""
    return "".join(letter if " " <= letter <= "~" else "?" for letter in text)
