"""Draw a snapshot on its image: oriented boxes, front marks, names, a header. Pure.

Units and frames: image pixels, x right, y down; angles clockwise on screen in radians; colours are red, green, blue
here and turned to OpenCV's order only where OpenCV draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.certainty import certainty
from gcs.report.box_shapes import Rect, box_bounds, box_corners, drawable, front_mark
from gcs.report.inset import Inset, crop, inset_for, moved_boxes, title_of
from gcs.report.label_grid import Cells, Grid
from gcs.report.labels import Label, Labelling, leader_of, place_labels
from gcs.report.vehicle_names import ShownName, shown_names
from gcs.snapshot import Box, Snapshot, Standing

Rgb = tuple[int, int, int]

STANDING_RGB: Final[Mapping[Standing, Rgb]] = MappingProxyType(
    {
        "confirmed": (140, 240, 120),
        "tentative": (226, 176, 10),
        "coasting": (104, 158, 245),
        "unidentified": (246, 184, 255),
        "out of view": (163, 171, 187),
        "no position": (240, 112, 96),
        "misplaced": (240, 112, 96),
        "no new frame": (233, 236, 240),
    }
)
"""Colour of each standing: far enough apart to be distinguished without red, green or blue cones, and bright enough on
the dark. The two of vehicles whose place nobody knows are one colour."""
DARK: Final[Rgb] = (14, 18, 26)
"""Behind labels and where there is no image."""
CROWD: Final = 16
"""Largest fleet whose confirmed names have their certainty; in a larger one what is not sure stands out."""
FAR_MS: Final = 250_000_000_000_000
HEADER_INK: Final = (214, 222, 235)
EMPTY_SIZE: Final = (1280, 720)
FONT: Final = cv2.FONT_HERSHEY_SIMPLEX


def standing_of(snapshot: Snapshot, box: Box) -> Standing:
    """The certainty of a box's name, in the same words as the fleet table."""
    if box.coasting and not box.in_turn:
        return "coasting"
    if not box.system_id:
        return "unidentified"
    for row in snapshot.vehicles:
        if row.system_id == box.system_id and row.standing in ("confirmed", "tentative"):
            return row.standing
    return "tentative"


def rgb_of(snapshot: Snapshot, box: Box) -> Rgb:
    """Colour of a box: that of its standing, or of a misplaced vehicle's where nobody is to act on its name."""
    return STANDING_RGB["misplaced" if is_doubted(snapshot, box) else standing_of(snapshot, box)]


def is_doubted(snapshot: Snapshot, box: Box) -> bool:
    """Tell whether an alarm says that nobody is to act on a box's name."""
    return bool(box.system_id) and box.system_id in snapshot.doubted


def label_of(snapshot: Snapshot, box: Box) -> str:
    """``UGV-3 97%`` confirmed, ``UGV-3? 61%`` tentative, ``~UGV-3 88%`` coasting, ``?`` unidentified, ``~?`` both,
    ``#5`` with its number where there are several cameras, ``UGV-3 stated`` by the operator (``? stated``: none of
    ours), ``UGV-3 97% (0.8s)`` held, for want of a newer frame;
    ``!UGV-3 97%`` is a name on which nobody is to act, so marked without colours too."""
    held = f" ({snapshot.held_s:.1f}s)" if snapshot.held_s else ""
    return _label(snapshot, box, snapshot.name_of(box.system_id) if box.system_id else unnamed(box)) + held


def unnamed(box: Box) -> str:
    """Mark of a box without a name, with the number that it has in all pictures: ``#11``, beside ``11?`` for an id."""
    return f"#{box.number}" if box.number else "?"


def _label(snapshot: Snapshot, box: Box, name: str, *, certain: bool = True) -> str:
    standing = standing_of(snapshot, box)
    stated = box.stated and not box.coasting
    word = "stated" if stated else certainty(box.confidence) if box.system_id else ""
    sure = f" {word}" if word and certain else ""
    before = ("!" if is_doubted(snapshot, box) else "") + ("~" if standing == "coasting" else "")
    after = "?" if standing == "tentative" and not box.stated else ""
    return f"{before}{name}{after}{sure}"


def named_count(snapshot: Snapshot) -> tuple[int, int]:
    """Confirmed ground vehicles and all ground vehicles."""
    standings = [row.standing for row in snapshot.vehicles if row.role == "ugv"]
    return standings.count("confirmed"), len(standings)


def is_picked(box: Box, selected: int, track: int) -> bool:
    """Tell whether a box is of the picked vehicle, or is the picked box without a name; 0 none."""
    return bool(selected and box.system_id == selected) or bool(track and box.track_id == track)


def boxes_in_order(snapshot: Snapshot, selected: int, track: int) -> list[Box]:
    """Boxes that can be drawn, those first whose label is most wanted."""
    return sorted(
        filter(drawable, snapshot.boxes),
        key=lambda box: (not is_picked(box, selected, track), box.system_id == 0, -box.cy),
    )


def box_texts(snapshot: Snapshot, box: Box, shown: ShownName | None, *, brief: bool = False) -> tuple[str, ...]:
    """Texts that may stand beside a box, the best first: with certainty unless ``brief``, then without, then with the
    id. How old held names are stands above the picture: a label that grew would move all others."""
    if shown is None:
        return (_label(snapshot, box, snapshot.name_of(box.system_id) if box.system_id else unnamed(box)),)
    certain = (False,) if brief else (True, False)
    texts = (_label(snapshot, box, name, certain=each) for name in (shown.name, shown.short) for each in certain)
    return tuple(dict.fromkeys(texts))


def box_labels(
    snapshot: Snapshot,
    boxes: Sequence[Box],
    anchors: Sequence[Cells],
    shows: Callable[[str], bool],
    pick: tuple[int, int] = (0, 0),
) -> list[Label]:
    """Labels of boxes.

    Args:
        boxes: Those that are drawn, in the order in which they choose.
        shows: Whether the picture can show all letters of a text.
        pick: System id and track id of what is picked, 0 none: its label is placed with its best text.
    """
    names = shown_names(snapshot, shows)
    crowded = len(snapshot.vehicles) > CROWD
    labels = []
    for key, box, anchor in zip(box_keys(boxes), boxes, anchors, strict=True):
        shown, highlighted = names.get(box.system_id), is_picked(box, *pick)
        brief = crowded and not highlighted and standing_of(snapshot, box) == "confirmed" and not box.stated
        texts = box_texts(snapshot, box, shown, brief=brief and not is_doubted(snapshot, box))
        legend = shown.legend if shown else ""
        short = 0 if shown is None or shown.name == shown.short else len(texts) // 2
        labels.append(Label(key=key, anchor=anchor, texts=texts, legend=legend, short=short, highlighted=highlighted))
    return labels


def box_keys(boxes: Sequence[Box]) -> list[int]:
    """Owner of a label: the box's track, below 0 for boxes without one."""
    keys: list[int] = []
    for index, box in enumerate(boxes):
        keys.append(box.track_id if box.track_id > 0 and box.track_id not in keys else -1 - index)
    return keys


def image_inset(
    snapshot: Snapshot, *, scale: float, selected: int, track: int = 0, former: Inset | None = None
) -> Inset | None:
    """Area in which ``draw`` shows the picked vehicle enlarged, below the header; None where that is not known."""
    width, height = _size(snapshot, scale)
    top = math.ceil(_text_size("0", _unit(height))[1])
    marks = []
    for box in boxes_in_order(snapshot, selected, track):
        x, y, w, h = box_bounds(box, scale)
        marks.append((box, (math.floor(x), math.floor(y), math.ceil(w), math.ceil(h))))
    picked = next((box for box, _ in marks if is_picked(box, selected, track)), None)
    return inset_for(snapshot, selected, (0, top, width, max(0, height - top)), marks, picked, former=former)


def image_labels(
    snapshot: Snapshot,
    *,
    scale: float = 1.0,
    selected: int = 0,
    track: int = 0,
    former: Labelling | None = None,
    inset: Inset | None = None,
) -> Labelling:
    """Cells in which ``draw`` writes, in squares of pixels.

    Args:
        scale: As for ``draw``.
        selected: As for ``draw``.
        track: As for ``draw``.
        former: Of the frame before, so that labels stay where they are.
        inset: As for ``draw``: no label is on it.
    """
    width, height = _size(snapshot, scale)
    unit = _unit(height)
    square = _square(unit)

    def measure(text: str) -> tuple[int, int]:
        across, down = _text_size(text, unit)
        return math.ceil(across / square), math.ceil(down / square)

    boxes = boxes_in_order(snapshot, selected, track)
    anchors = [_squares(box_bounds(box, scale, 2 * unit), square) for box in boxes]
    line = measure("0")[1]
    header = (0.0, 0.0, *_text_size(_header_of(snapshot, unit, width), unit))
    grid = Grid(
        columns=width // square,
        rows=height // square,
        measure=measure,
        step=(line, line),
        gap=1,
        blocked=tuple(_squares(rect, square) for rect in (header, *([inset.rect] if inset else []))),
        covered=True,
    )
    return place_labels(box_labels(snapshot, boxes, anchors, _is_ascii, (selected, track)), grid, former)


def _squares(rect: Rect, square: int) -> Cells:
    x, y, w, h = rect
    left, top = math.floor(x / square), math.floor(y / square)
    return left, top, math.ceil((x + w) / square) - left, math.ceil((y + h) / square) - top


def draw(
    snapshot: Snapshot,
    *,
    scale: float = 1.0,
    selected: int = 0,
    track: int = 0,
    labelling: Labelling | None = None,
    inset: Inset | None = None,
) -> NDArray[np.uint8]:
    """The image with boxes, front ticks, names and a header with time and fleet summary.

    Args:
        snapshot: Its image is left as it is; without one the canvas is dark.
        scale: Size of the result against the image, above 0.
        selected: System id to stress, 0 none.
        track: Track id of a box without a name to stress, 0 none.
        labelling: Of ``image_labels`` for the same snapshot, scale, selection and inset; worked out unless given.
        inset: Of ``image_inset``, None for none.

    Returns:
        (round(height · scale), round(width · scale), 3) uint8 BGR.
    """
    canvas = _canvas(snapshot, scale)
    unit = _unit(canvas.shape[0])
    square = _square(unit)
    boxes = boxes_in_order(snapshot, selected, track)
    labelling = labelling or image_labels(snapshot, scale=scale, selected=selected, track=track, inset=inset)
    for box in boxes:
        _draw_box(canvas, box, rgb_of(snapshot, box), scale, unit)
    owners = dict(zip(box_keys(boxes), boxes, strict=True))
    inks = {key: rgb_of(snapshot, box) for key, box in owners.items()}
    for place in (*labelling.places, *labelling.counts):
        if place.leader:
            x, y, end_x, end_y = (round(value * square) for value in leader_of(place))
            cv2.line(canvas, (x, y), (end_x, end_y), DARK[::-1], 3, cv2.LINE_AA)
            cv2.line(canvas, (x, y), (end_x, end_y), inks.get(place.key, HEADER_INK)[::-1], 1, cv2.LINE_AA)
    if inset is not None:
        _draw_inset(canvas, snapshot, boxes, inset, selected, scale)
    for place in labelling.texts:
        colour = inks.get(place.key, HEADER_INK)
        highlighted = place.key in owners and is_picked(owners[place.key], selected, track)
        corner = place.rect[0] * square, place.rect[1] * square
        _draw_text(canvas, place.text, corner, unit, *((DARK, colour) if highlighted else (colour, DARK)))
    _draw_text(canvas, _header_of(snapshot, unit, canvas.shape[1]), (0, 0), unit, HEADER_INK, DARK)
    return canvas


def inset_label(snapshot: Snapshot, boxes: Sequence[Box], inset: Inset, selected: int) -> str:
    """Name of the vehicle in an inset: as beside its box, which is the first of those in order."""
    return label_of(snapshot, boxes[0]) if inset.seen else snapshot.name_of(selected)


def _draw_inset(
    canvas: NDArray[np.uint8], snapshot: Snapshot, boxes: Sequence[Box], inset: Inset, selected: int, scale: float
) -> None:
    x, y, width, height = inset.rect
    unit = _unit(canvas.shape[0])
    window = canvas[y : y + height, x : x + width]
    part = crop(snapshot, inset)
    window[:] = DARK[::-1]
    if part is not None:
        window[:] = cv2.resize(part, (width, height), interpolation=cv2.INTER_CUBIC)
    larger = width / inset.part[2]
    for box in moved_boxes(boxes, inset):
        _draw_box(window, box, rgb_of(snapshot, box), larger, unit)
    title = title_of(
        inset_label(snapshot, boxes, inset, selected),
        larger / scale,
        seen=inset.seen,
        shows=lambda text: _is_ascii(text) and _text_size(text, unit)[0] <= width,
    )
    _draw_text(canvas, title, (x, y), unit, HEADER_INK, DARK)
    cv2.rectangle(canvas, (x, y), (x + width - 1, y + height - 1), HEADER_INK[::-1], 1)


def _unit(height: int) -> float:
    return max(0.75, height / 900)


def _square(unit: float) -> int:
    return max(2, round(4 * unit))


def _size(snapshot: Snapshot, scale: float) -> tuple[int, int]:
    width, height = (snapshot.width, snapshot.height) if snapshot.width and snapshot.height else EMPTY_SIZE
    return max(1, round(width * scale)), max(1, round(height * scale))


def _canvas(snapshot: Snapshot, scale: float) -> NDArray[np.uint8]:
    size = _size(snapshot, scale)
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


def _draw_text(
    canvas: NDArray[np.uint8], text: str, corner: tuple[int, int], unit: float, ink: Rgb, paper: Rgb
) -> None:
    if not text:
        return
    x, y = corner
    w, h = (round(side) for side in _text_size(text, unit))
    cv2.rectangle(canvas, (x, y), (x + w - 1, y + h - 1), paper[::-1], cv2.FILLED)
    origin = x + round(4 * unit), y + h - round(5 * unit)
    cv2.putText(canvas, text, origin, FONT, 0.55 * unit, ink[::-1], max(1, round(unit)), cv2.LINE_AA)


def _header_of(snapshot: Snapshot, unit: float, width: int) -> str:
    """Time, frame and fleet; as many of these as the image is wide enough for."""
    # counted from the epoch, since the platform's clock functions refuse far times
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=snapshot.now_us // 100_000 * 100 % FAR_MS)
    named, total = named_count(snapshot)
    unnamed = sum(box.system_id == 0 for box in snapshot.boxes)
    parts = [
        moment.strftime("%Y-%m-%d %H:%M:%S.%f")[:-5] + "Z",
        *([f"names {snapshot.held_s:.1f}s old"] if snapshot.held_s else []),
        f"frame {snapshot.frame}",
        f"{named}/{total} confirmed",
    ]
    parts += [f"{unnamed} ?"] if unnamed else []
    while parts and _text_size("   ".join(parts), unit)[0] > width:
        parts.pop()
    return "   ".join(parts)


def _is_ascii(text: str) -> bool:
    """OpenCV's fonts hold printable ASCII only."""
    return all(" " <= letter <= "~" for letter in text)
