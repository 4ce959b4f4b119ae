"""Lines on the map beside the vehicles' own: trails, fences, and the ruler between two places. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.snapshot import Snapshot
from gcs.trails import Trail
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.format import degrees, metres
from gcs.tui.draw.ground_view import MapView
from gcs.tui.palette import BRIGHT, PANEL, WARN, pack

CURSOR_MARK: Final = "┼"
PICK_MARKS: Final = ("⊕", "⊗")
"""The first and the second place that are measured."""
HOME_MARK: Final = "⌂"
FADES: Final = (0.85, 0.65, 0.45, 0.3)
"""Strength of a trail's four quarters, from now back."""
FENCE_EVERY: Final = 3.0
"""Dots between those of a fence: its gaps distinguish it from boxes and circles."""

Place = tuple[float, float]
"""East, north, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruler:
    """Ruler from place to place that the operator points at."""

    cursor: Place | None = None
    picks: tuple[Place, ...] = field(default=())
    """None, one or two places."""

    def picked(self) -> Ruler:
        """Return the ruler with the place under the cursor; a third one starts again."""
        if self.cursor is None:
            return self
        return Ruler(cursor=self.cursor, picks=(*self.picks, self.cursor) if len(self.picks) < 2 else (self.cursor,))

    def shifted(self, east: float, north: float) -> Ruler:
        """Return the ruler with the same places about another origin."""
        cursor, *picks = [place and (place[0] + east, place[1] + north) for place in (self.cursor, *self.picks)]
        return Ruler(cursor=cursor, picks=tuple(place for place in picks if place))

    @property
    def ends(self) -> tuple[Place, Place] | None:
        """Ends of what is measured: both picks, or the only one and the cursor."""
        if len(self.picks) == 2:
            return self.picks[0], self.picks[1]
        return (self.picks[0], self.cursor) if self.picks and self.cursor else None


def ruler_texts(ruler: Ruler, snapshot: Snapshot) -> list[str]:
    """Distance and bearing between two places, and where the cursor is; the most wanted first."""
    texts = []
    if ruler.ends is not None:
        (east, north), (to_east, to_north) = ruler.ends
        # bearing clockwise from north
        away = math.hypot(to_east - east, to_north - north)
        texts.append(f"{metres(away)} {degrees(math.atan2(to_east - east, to_north - north))}")
    if ruler.cursor is not None:
        east, north = ruler.cursor
        if snapshot.origin is not None:
            lat, lon, _ = snapshot.origin.to_geodetic((east, north, 0.0))
            texts.append(f"{float(lat):.6f} {float(lon):.6f}")
        texts.append(f"E {east:+.1f} N {north:+.1f} m")
    return texts


def draw_ruler(dots: BrailleCanvas, ruler: Ruler, view: MapView) -> None:
    """Draw a dotted line between what is measured."""
    if ruler.ends is not None:
        start, end = view.dots(np.array(ruler.ends))
        dots.line(start, end, pack(BRIGHT), every=2.0)


def draw_fences(dots: BrailleCanvas, snapshot: Snapshot, view: MapView) -> None:
    """Draw the mission's fences."""
    for outline in snapshot.fence_enu:
        dots.polygon(view.dots(outline), pack(WARN), every=FENCE_EVERY)


def draw_trails(dots: BrailleCanvas, trails: Sequence[Trail], view: MapView, inks: Mapping[int, int]) -> None:
    """Draw the trails, the oldest first, fading into the background."""
    starts, ends, faded = [], [], []
    for trail in trails:
        if trail.system_id in inks and len(trail.age) > 1:
            fades = np.array([_mixed(inks[trail.system_id], pack(PANEL), share) for share in FADES], dtype=np.int64)
            band = np.clip((trail.age[:-1] * len(FADES)).astype(np.int64), 0, len(FADES) - 1)
            starts.append(trail.p_enu[:-1])
            ends.append(trail.p_enu[1:])
            faded.append(fades[band])
    if starts:
        dots.lines(view.dots(np.concatenate(starts)), view.dots(np.concatenate(ends)), np.concatenate(faded))


def _mixed(ink: int, paper: int, share: float) -> int:
    mixed = 0
    for shift in (16, 8, 0):
        mixed |= round(share * (ink >> shift & 255) + (1 - share) * (paper >> shift & 255)) << shift
    return mixed
