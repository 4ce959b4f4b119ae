"""Looking at a film in turns, where the whole picture at the scale of small vehicles takes too long.

From twice the height vehicles are half as long, the picture is looked at at twice the scale, and that takes four times
as long. Most of it is empty. So each frame is looked at where vehicles were found before, as they and the camera move,
and where vehicles report to be; those that were not looked at for longest first, as many as a frame's share of time
has room for. The rest of the picture is gone through tile by tile, all of it once in ``ROUND_S``, at a coarser scale at
which boxes are too bad to count and good enough to tell where to look. What counts is seen at the full scale, in parts
with so much round a vehicle that it is seen as in the whole picture (docs/model_card.md has how nearly).

What was looked at goes with the boxes (``Detections.looked``): elsewhere no box is no evidence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from vision.detect.detections import Detections
from vision.detect.detector import Detector, PartialDetector
from vision.detect.tiles import Tile, tile_grid

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Point = tuple[float, float]
Rect = tuple[float, float, float, float]

STEP_PX = 32
"""Sides of parts are multiples of this, px of the canvas."""
BORDER_PX = 56
"""Border of a part, in which no centre counts, px of the canvas: with 96 px of the picture on each side of a vehicle
AP50 is lower by 0.001 than in the whole picture, with 80 by 0.006, with 64 by 0.02 (photographs of streets)."""
ROUND_FRAMES, COARSEST, PROPOSES = 2.2, 0.5, 0.15
"""Frames' worth of pixels for a round, the least scale for that, of the full one, and the score from which a box there
is looked at again: on photographs 0.98 of the vehicles have one at half the scale, as many as at the full one, and six
in ten of such boxes are vehicles."""
TILE_PX, OVERLAP_PX = 320, 48
"""Side of a tile of the rounds, at most, and the overlap of two, px of the canvas."""
ROUND_S = 0.9
"""Time in which the whole picture is gone through."""
MAX_ROUND = 0.6
"""Share of a frame's pixels for the rounds at most, however slow frames come."""
WORTH_FRAMES = 1.3
"""Frames' worth of pixels up to which a picture is looked at as a whole: turns would save a sixth, and miss more."""
FIRST_FRAMES, LONGEST_US = 10, 1_500_000
"""A first frame, or one this long after the last, is looked at as a whole where that is no more than this many frames'
worth of pixels: names begin at once, half a second late at the most."""
MAX_ALONE = 0.4
"""Share of what is left of a frame's pixels for reports that nothing explains: many may be wrong."""
REPORTED_US = 350_000
"""Time after which the place where a vehicle reports to be and none was found is looked at again."""
KEPT_US, FORGOTTEN_US, AGAIN_US = 1_000_000, 3_000_000, 1_500_000
"""A place is given up when nothing was found there for this long although it was looked at; in any case; and one that
was only proposed, and is empty, may be proposed again."""
MAX_PLACES = 300
"""Places that are followed, at most."""
REACH_PX, MAX_REACH_PX = 40.0, 130.0
"""A box is the vehicle of a place, and a report that of one, within this many px of the canvas and σ of the report; of
a report no more is looked at."""
FOLLOWS = 0.5
"""Share of a new velocity in that of a place."""


class _LookPlace(NamedTuple):
    """Place to look at, px of the image."""

    at: Point
    """Position at which it is expected in this frame."""
    base: Point = (math.nan, math.nan)
    """Position in the last frame, or, while it goes unseen, in the last but one."""
    unseen: bool = False
    v: Point = (0.0, 0.0)
    """px/s, the camera's motion taken out."""
    seen_us: int = 0
    """Time at which a vehicle was found there last; 0: never, it is only proposed."""
    looked_us: int = 0
    """Time at which it was looked at last; 0 never."""
    reach_px: float = REACH_PX
    """Distance from it at which the vehicle may be, px of the canvas."""
    of_report: bool = False
    """A vehicle reports to be there, and none was found: it is for this frame alone."""
    empty: bool = False
    """True if it was proposed, looked at, and nothing is there."""

    def lasts(self, t_us: int, *, looked: bool) -> bool:
        """Tell whether it is kept after a frame in which nothing was found there."""
        if self.seen_us == 0:
            return not self.of_report and (not self.empty or t_us - self.looked_us < AGAIN_US)
        return t_us - self.seen_us < (KEPT_US if looked else FORGOTTEN_US)


class LookInTurns:
    """Looks at the frames of one film, in order, from one thread. Equal frames, times and reports give equal boxes.

    Args:
        detector: what looks; one that cannot look at parts looks at whole frames.
        score: boxes from here on begin a place.
    """

    def __init__(self, detector: Detector, score: float) -> None:
        self._detector, self._score = detector, score
        self._places: list[_LookPlace] = []
        self._reported_us: dict[int, int] = {}
        self._tiles_us: list[int] = []
        self._due = 0.0
        """Tiles that are due."""
        self._t_us = 0

    def look(
        self,
        image: Image,
        t_us: int,
        gsd_m: float | None,
        *,
        moved: Floats | None = None,
        reported: Callable[[], Mapping[int, tuple[float, float, float]]],
    ) -> Detections:
        """Find the vehicles of a frame.

        Args:
            image: (H, W, 3) BGR.
            t_us: when it was taken.
            gsd_m: ground metres a pixel, None unknown: the whole frame is looked at.
            moved: (3, 3) homography from the last but one frame to the last, None unknown: the camera goes on so.
            reported: gives where vehicles report to be, by an id of theirs: x, y and their 1σ, px.
        """
        detector, height, width = self._detector, *image.shape[:2]
        anew = not self._t_us or t_us - self._t_us > LONGEST_US
        dt = 0.0 if anew else min(max(t_us - self._t_us, 0) * 1e-6, ROUND_S)
        self._t_us = t_us
        if gsd_m is None or not in_turns(detector, (width, height), gsd_m):
            return self._look_at_all(image, gsd_m)
        scale = detector.scale(gsd_m)
        if anew and width * height * scale**2 <= FIRST_FRAMES * detector.frame_px:
            return self._look_at_all(image, gsd_m)
        places = [_moved(place, moved, dt) for place in self._places]
        places = [place for place in places if 0.0 <= place.at[0] <= width and 0.0 <= place.at[1] <= height]
        proposed, used_px = self._go_round(detector, image, gsd_m, dt)
        places += _apart(proposed, places, REACH_PX / scale)
        asked = reported()
        left_px = detector.frame_px / detector.part_price - used_px
        places += _fitting(self._reports_alone(asked, places, scale, (width, height)), MAX_ALONE * left_px)
        # what was never looked at comes first, then what was not for longest
        order = sorted((place for place in places if not place.empty), key=lambda place: (place.looked_us, place.at))
        parts = _parts(order, scale, (width, height), left_px)
        found = detector.detect_in(image, parts, gsd_m=gsd_m) if parts else Detections.empty()
        looked = np.clip(np.array([part.kept for part in parts]).reshape(-1, 4), 0.0, (width, height) * 2)
        found = replace(found, looked=looked)
        self._places = self._followed(places, found, scale)
        seen = found.looked_at([(x, y) for x, y, _ in asked.values()]).tolist()
        self._reported_us |= dict.fromkeys((i for i, looked_at in zip(asked, seen, strict=True) if looked_at), t_us)
        return found

    def _look_at_all(self, image: Image, gsd_m: float | None) -> Detections:
        """Look at the whole picture, and begin with what is there."""
        found = self._detector.detect(image, gsd_m=gsd_m)
        self._tiles_us = []
        self._places = self._followed((), found, 1.0)
        return found

    def _go_round(self, detector: PartialDetector, image: Image, gsd_m: float, dt: float) -> tuple[Detections, float]:
        """Look at the tiles that were not looked at for longest, coarsely: what is proposed, and its price in px."""
        height, width = image.shape[:2]
        full, frame_px = detector.scale(gsd_m), detector.frame_px / detector.part_price
        coarse = min(max(math.sqrt(ROUND_FRAMES * frame_px / (width * height)) / full, COARSEST), 1.0)
        scale = detector.scale(coarse * gsd_m)
        side = math.ceil(TILE_PX / scale)
        tiles = tile_grid((width, height), (side, side), OVERLAP_PX / scale)
        each_px = (tiles[0].right - tiles[0].left) * (tiles[0].bottom - tiles[0].top) * scale**2
        room = min(max(int(MAX_ROUND * frame_px / each_px), 1), len(tiles))
        if len(tiles) != len(self._tiles_us):
            self._tiles_us, self._due = [0] * len(tiles), float(room)
        self._due = min(self._due + len(tiles) * dt / ROUND_S, len(tiles))
        # what was not looked at for longest
        order = sorted(range(len(tiles)), key=self._tiles_us.__getitem__)
        chosen = order[: min(int(self._due + 1e-6), room)]
        if not chosen:
            return Detections.empty(), 0.0
        self._due -= len(chosen)
        for k in chosen:
            self._tiles_us[k] = self._t_us
        found = detector.detect_in(image, [tiles[k] for k in chosen], gsd_m=coarse * gsd_m)
        return found.at_least(PROPOSES), each_px * len(chosen)

    def _reports_alone(
        self,
        reported: Mapping[int, tuple[float, float, float]],
        places: Sequence[_LookPlace],
        scale: float,
        size: tuple[int, int],
    ) -> Iterator[_LookPlace]:
        """Places of the reports that no place explains, where nobody looked for a while."""
        known = np.array([place.at for place in places if place.seen_us]).reshape(-1, 2)
        for system_id, (x, y, std) in reported.items():
            reach = min(REACH_PX + 2.0 * std * scale, MAX_REACH_PX)
            last_us = self._reported_us.get(system_id, 0)
            due = not last_us or self._t_us - last_us >= REPORTED_US
            if not (due and 0.0 <= x <= size[0] and 0.0 <= y <= size[1]):
                continue
            if not (np.hypot(known[:, 0] - x, known[:, 1] - y) * scale < reach).any():
                yield _LookPlace(at=(x, y), reach_px=reach, looked_us=last_us, of_report=True)

    def _followed(self, places: Sequence[_LookPlace], found: Detections, scale: float) -> list[_LookPlace]:
        """The places after a frame, as its boxes have them."""
        t_us, centre = self._t_us, found.centre
        at = np.array([place.at for place in places]).reshape(-1, 2)
        looked = found.looked_at(at).tolist()
        away = np.linalg.norm(at[:, None] - centre[None], axis=2) * scale
        reach = np.array([[place.reach_px] for place in places]).reshape(-1, 1)
        pairs = np.argwhere(away < reach)
        pairs = pairs[np.argsort(away[pairs[:, 0], pairs[:, 1]], kind="stable")]
        box_of = dict[int, int]()
        free = set(range(len(found)))
        for k, j in pairs.tolist():
            if k not in box_of and j in free and (places[k].seen_us or found.score[j] >= self._score):
                box_of[k] = j
                free.discard(j)
        after = [
            _seen(place, tuple(centre[box_of[k]].tolist()), t_us)
            if k in box_of
            else place._replace(unseen=True, looked_us=t_us, empty=not place.seen_us)
            if looked[k] and not place.empty
            else place._replace(unseen=True)
            for k, place in enumerate(places)
        ]
        kept = [place for k, place in enumerate(after) if k in box_of or place.lasts(t_us, looked=looked[k])]
        begun = [j for j in sorted(free) if found.score[j] >= self._score]
        kept += [_seen(_LookPlace(at=(x, y)), (x, y), t_us) for x, y in centre[begun].tolist()]
        return sorted(kept, key=lambda place: -place.seen_us)[:MAX_PLACES]


def in_turns(detector: Detector, size: tuple[int, int], gsd_m: float | None) -> TypeGuard[PartialDetector]:
    """Tell whether an image of a width and height, px, is looked at in turns."""
    if gsd_m is None or not isinstance(detector, PartialDetector):
        return False
    return size[0] * size[1] * detector.scale(gsd_m) ** 2 > WORTH_FRAMES * detector.frame_px


def _moved(place: _LookPlace, H: Floats | None, dt: float) -> _LookPlace:
    """A place as it is expected in the next frame, by its own motion and the camera's last one."""
    base = place.base
    if math.isnan(base[0]):
        base = place.at
    elif place.unseen:
        base = _step(base, place.v, H, dt)
    return place._replace(base=base, at=_step(base, place.v, H, dt))


def _step(at: Point, v: Point, H: Floats | None, dt: float) -> Point:
    x, y, w = (*at, 1.0) if H is None else (H @ (*at, 1.0)).tolist()
    return x / w + v[0] * dt, y / w + v[1] * dt


def _seen(place: _LookPlace, at: Point, t_us: int) -> _LookPlace:
    """A place at which a vehicle is found."""
    v, since_s = place.v, (t_us - place.seen_us) * 1e-6
    if place.seen_us and since_s > 0.0:
        v = (v[0] + FOLLOWS * (at[0] - place.at[0]) / since_s, v[1] + FOLLOWS * (at[1] - place.at[1]) / since_s)
    return _LookPlace(at=at, base=at, v=v, seen_us=t_us, looked_us=t_us)


def _apart(proposed: Detections, places: Sequence[_LookPlace], reach: float) -> list[_LookPlace]:
    """New places for the proposals that none has within a reach, px."""
    known = [place.at for place in places]
    new = []
    for x, y in proposed.centre.tolist():
        if all(math.hypot(x - a, y - b) >= reach for a, b in known):
            known.append((x, y))
            new.append(_LookPlace(at=(x, y)))
    return new


def _fitting(places: Iterable[_LookPlace], most_px: float) -> list[_LookPlace]:
    """Choose the places that were not looked at for longest, as many as fit into so many px of the canvas hold, at
    least one."""
    chosen, used = list[_LookPlace](), 0.0
    for place in sorted(places, key=lambda place: (place.looked_us, place.at)):
        used += (2.0 * (place.reach_px + BORDER_PX)) ** 2
        if used > most_px and chosen:
            break
        chosen.append(place)
    return chosen


def _parts(places: Iterable[_LookPlace], scale: float, size: tuple[int, int], most_px: float) -> list[Tile]:
    """Parts of a picture (width, height) round places, as many in their order as so many px of the canvas hold.

    Two are one part where that takes no more pixels.
    """
    parts: list[Rect] = []
    used = 0.0
    for place in places:
        x, y = place.at[0] * scale, place.at[1] * scale
        need = place.reach_px + BORDER_PX
        alone = (x - need, y - need, x + need, y + need)
        more = [_price(_round_both(part, alone)) - _price(part) for part in parts]
        best = min(range(len(parts)), key=more.__getitem__, default=-1)
        joins = best >= 0 and more[best] <= _price(alone)
        used += more[best] if joins else _price(alone)
        if used > most_px:
            break
        if joins:
            parts[best] = _round_both(parts[best], alone)
        else:
            parts.append(alone)
    return [_tile(part, scale, size) for part in parts]


def _round_both(a: Rect, b: Rect) -> Rect:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _sides(part: Rect) -> Point:
    """Width and height of a part in whole steps, px of the canvas."""
    return (
        STEP_PX * math.ceil((part[2] - part[0]) / STEP_PX - 1e-6),
        STEP_PX * math.ceil((part[3] - part[1]) / STEP_PX - 1e-6),
    )


def _price(part: Rect) -> float:
    width, height = _sides(part)
    return width * height


def _tile(part: Rect, scale: float, size: tuple[int, int]) -> Tile:
    """A part as one of the image, moved into it; at the image's own edge centres count up to it."""
    ends = []
    for low, high, side, length in zip(part[:2], part[2:], _sides(part), size, strict=True):
        span = min(round(side / scale), length)
        start = min(max(round((low + high) / (2.0 * scale) - span / 2.0), 0), length - span)
        border = BORDER_PX / scale
        kept_low = start + border if start > 0 else -math.inf
        kept_high = start + span - border if start + span < length else math.inf
        ends.append((start, start + span, kept_low, kept_high))
    (left, right, x0, x1), (top, bottom, y0, y1) = ends
    return Tile(left=left, top=top, right=right, bottom=bottom, kept=(x0, y0, x1, y1))
