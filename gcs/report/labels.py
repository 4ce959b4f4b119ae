"""Places of names on a picture, so that none is cut or covered. Pure.

Each label gets the best place that is free: beside its mark, else farther away with a line to it, else in a shorter
text that the legend explains; what finds no place at all is counted ("+3").

Units: whole cells of a grid, x right, y down: those of a terminal, or squares of pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from gcs.report.label_grid import Cells, Grid, Occupied, line_between, needs_line

RINGS: Final = 5
"""Number of steps that a label may be away from its mark: a line much longer is hard to follow."""
RING_COST: Final = 2.0
SHORTER_COST: Final = 100.0
"""Cost of a shorter text: a whole name anywhere is better than a part of it nearby."""
ADVANTAGE: Final = 1.5
"""Advantage, with room around, for which a label leaves a place that is still free: else it would flicker."""
IMPROVED_AT_ONCE: Final = 5
"""Labels that look for a better place in each frame, in turn: it takes longest."""
LEGEND_SHARE: Final = 3
"""Part of the picture's height that the legend keeps to: the lowest third."""
LEGEND_ROUNDS: Final = 4
COUNTED_NEAR: Final = 6
"""Steps within which labels without a place are counted together."""
COUNT_KEY: Final = -1_000_000
"""Keys of counts are this minus the first label's, which is below any other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """Label to be written beside a mark."""

    key: int
    """Owner, the same from frame to frame."""
    anchor: Cells
    """The mark, which may reach over the edge."""
    texts: tuple[str, ...]
    """The best first, each shorter than the one before."""
    legend: str = ""
    """Explains the texts from ``short`` on, empty where they need no explanation."""
    short: int = 1
    highlighted: bool = False
    """Placed first and with its best text if that is possible at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A text and where it stands."""

    key: int
    text: str
    rect: Cells
    form: int = 0
    """Index of the text among the label's."""
    leader: bool = False
    """True if a line to the mark is needed."""
    anchor: Cells = (0, 0, 0, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Labelling:
    """Every text of a picture; no two of them have a cell in common."""

    places: tuple[Place, ...] = ()
    """Places of the labels that found room, in the order given."""
    counts: tuple[Place, ...] = ()
    """``+3``: so many labels found none here; ``+24 names`` of the whole picture, in its corner."""
    legend: tuple[Place, ...] = ()
    """Meanings of the shorter texts."""
    former: Mapping[int, tuple[int, int, int]] = field(default_factory=dict)
    """Form and offset from the mark, by key."""
    turn: int = 0
    """Number of frames that came before."""

    @property
    def texts(self) -> tuple[Place, ...]:
        """Texts that are written."""
        return (*self.places, *self.counts, *self.legend)


def place_labels(
    labels: Sequence[Label], grid: Grid, former: Labelling | None = None, marks: Iterable[Cells] = ()
) -> Labelling:
    """Place labels, those before first; the same arguments always give the same places.

    Args:
        labels: A later one takes what earlier ones leave; one whose mark lies outside of the grid is left out.
        former: Of the frame before: a label stays where it is while that place is free.
        marks: Marks without a label, which labels keep clear of as well.

    Returns:
        Where every label is, or in which count.
    """
    former = former or Labelling()
    labels = [label for label in (_inside(label, grid) for label in labels) if label is not None]
    present = {label.key: label for label in labels}
    explained = {place.key for place in former.legend if place.key in present and present[place.key].legend}
    spare = False
    for last in (*[False] * LEGEND_ROUNDS, True):
        occupied = Occupied(grid, [label.anchor for label in labels], list(marks))
        remainder = _room_for_count(occupied, len(labels)) if spare else None
        legend = [_legend_place(occupied, present[key]) for key in sorted(explained)]
        places, unplaced = _place_all(labels, occupied, former)
        counts, missing = _count(unplaced, occupied, former)
        if missing and not spare and not last:
            spare = True
            continue
        wanted = {place.key for place in places if place.form >= present[place.key].short and present[place.key].legend}
        if wanted <= explained or last:
            break
        explained |= wanted
    found = [place for place in legend if place is not None and place.key in wanted]
    if remainder is not None:  # what there is no room to explain is counted
        unexplained = wanted - {place.key for place in found}
        missing += len(unexplained)
        places = [place for place in places if place.key not in unexplained]
    if missing and remainder is not None:
        rect, word = remainder
        counts.append(Place(key=COUNT_KEY, text=f"+{missing}{word}", rect=rect))
    offsets = {
        p.key: (p.form, p.rect[0] - p.anchor[0], p.rect[1] - p.anchor[1])
        for p in (*places, *counts)
        if p.key != COUNT_KEY
    }
    return Labelling(
        places=tuple(places), counts=tuple(counts), legend=tuple(found), former=offsets, turn=former.turn + 1
    )


def leader_of(place: Place) -> tuple[float, float, float, float]:
    """The line from a label to its mark: x and y of the nearest point of the text's middle row, and of the mark."""
    return line_between(place.rect, place.anchor)


def _inside(label: Label, grid: Grid) -> Label | None:
    """Return the label with the part of its mark that is in the grid."""
    x, y, w, h = label.anchor
    left, top, right, bottom = max(0, x), max(0, y), min(x + w, grid.columns), min(y + h, grid.rows)
    if left >= right or top >= bottom:
        return None
    anchor = (left, top, right - left, bottom - top)
    return label if anchor == label.anchor else replace(label, anchor=anchor)


def _room_for_count(occupied: Occupied, most: int) -> tuple[Cells, str] | None:
    """Room for how many names of the whole picture are missing, and the word behind the number where that fits."""
    for word in (" names", ""):
        if rect := occupied.take_first(f"+{most}{word}", range(occupied.grid.rows)):
            return rect, word
    return None


def _legend_place(occupied: Occupied, label: Label) -> Place | None:
    rows = occupied.grid.rows
    height = occupied.grid.measure(label.legend)[1]
    rect = occupied.take_first(
        label.legend, range(rows - height, rows - max(height, rows // LEGEND_SHARE) - 1, -height)
    )
    return None if rect is None else Place(key=label.key, text=label.legend, rect=rect)


def _place_all(labels: Sequence[Label], occupied: Occupied, former: Labelling) -> tuple[list[Place], list[Label]]:
    """Place all labels: those that can stay do, then the others choose, then those in a poor place look for a better
    one."""
    placed: dict[int, Place] = {}
    for label in labels:
        if label.highlighted and former.former.get(label.key, (1,))[0] > 0:
            place = _search(label, occupied)
        else:
            place = _as_before(label, occupied, former)
        if place is not None:
            placed[label.key] = place
            occupied.take(place.rect)
    kept = list(placed)
    unplaced = []
    for label in labels:
        if label.key not in placed:
            place = _search(label, occupied)
            if place is None:
                unplaced.append(label)
            else:
                placed[label.key] = place
                occupied.take(place.rect)
    by_key = {label.key: label for label in labels}
    first = former.turn * IMPROVED_AT_ONCE % max(1, len(kept))
    for key in (kept * 2)[first : first + IMPROVED_AT_ONCE]:
        placed[key] = _improved(by_key[key], placed[key], occupied)
    return [placed[label.key] for label in labels if label.key in placed], unplaced


def _as_before(label: Label, occupied: Occupied, former: Labelling) -> Place | None:
    if label.key not in former.former:
        return None
    form, across, down = former.former[label.key]
    if form >= len(label.texts):
        return None
    width, height = occupied.grid.measure(label.texts[form])
    left = max(0, min(label.anchor[0] + across, occupied.grid.columns - width))
    top = max(0, min(label.anchor[1] + down, occupied.grid.rows - height))
    rect = (left, top, width, height)
    return _place(label, form, rect, occupied.grid) if occupied.fits(rect, label.anchor) else None


def _improved(label: Label, place: Place, occupied: Occupied) -> Place:
    occupied.release(place.rect)
    below = _cost_of(place, occupied) - ADVANTAGE
    better = (_search(label, occupied, margin=1, below=below) if below > 0 else None) or place
    occupied.take(better.rect)
    return better


def _cost_of(place: Place, occupied: Occupied) -> float:
    ring = _ring_of(place.rect, place.anchor, occupied.grid)
    base = place.form * SHORTER_COST + ring * RING_COST
    return base + occupied.nuisance(place.rect, place.anchor)


def _search(label: Label, occupied: Occupied, margin: int = 0, below: float = math.inf) -> Place | None:
    """The cheapest free place, None when there is none, or none cheaper than ``below``."""
    for form, text in enumerate(label.texts):
        size = occupied.grid.measure(text)
        best, least = None, below
        for ring in range(RINGS + 1):
            base = form * SHORTER_COST + ring * RING_COST
            if base >= least:
                break
            for rect in _spots(label.anchor, size, ring, occupied.grid.step):
                if base < least and occupied.fits(rect, label.anchor, margin):
                    cost = base + occupied.nuisance(rect, label.anchor)
                    if cost < least:
                        best, least = rect, cost
        if best is not None:
            return _place(label, form, best, occupied.grid)
    return None


def _place(label: Label, form: int, rect: Cells, grid: Grid) -> Place:
    away = needs_line(rect, label.anchor, grid.step)
    return Place(key=label.key, text=label.texts[form], rect=rect, form=form, anchor=label.anchor, leader=away)


def _ring_of(rect: Cells, anchor: Cells, grid: Grid) -> int:
    """Number of steps between a label and its mark."""
    left, top, width, height = rect
    x, y, w, h = anchor
    across, down = max(left - x - w, x - left - width, 0), max(top - y - h, y - top - height, 0)
    return max(-(-across // grid.step[0]), -(-down // grid.step[1]))


def _spots(anchor: Cells, size: tuple[int, int], ring: int, step: tuple[int, int]) -> Iterator[Cells]:
    """Places round a mark at a distance; a point's name is rather beside it, a box's above it."""
    x, y, w, h = anchor
    width, height = size
    across, down = ring * step[0], ring * step[1]
    left, right = x - width - across, x + w + across
    above, below = y - height - down, y + h + down
    middle, centre = x + (w - width) // 2, y + (h - height) // 2
    beside = [(right, centre), (left, centre)]
    over = [(middle, above), (middle, below)]
    first = [*beside, *over] if h <= height else [*over, *beside]
    aligned = [(x, above), (x, below), (x + w - width, above), (x + w - width, below)]
    corners = [(right, above), (left, above), (right, below), (left, below)]
    for place in (*first, *aligned, *corners):
        yield *place, width, height


def _count(unplaced: Sequence[Label], occupied: Occupied, former: Labelling) -> tuple[list[Place], int]:
    """``+3`` where three labels near each other found no place, and how many found not even that."""
    counts: list[Place] = []
    missing = 0
    waiting = list(unplaced)
    while waiting:
        first = waiting[0]
        near = [label for label in waiting if _near(first.anchor, label.anchor, occupied.grid.step)]
        waiting = [label for label in waiting if label not in near]
        label = Label(key=COUNT_KEY - first.key, anchor=first.anchor, texts=(f"+{len(near)}",))
        place = _as_before(label, occupied, former) or _search(label, occupied)
        if place is None:
            missing += len(near)
        else:
            occupied.take(place.rect)
            counts.append(place)
    return counts, missing


def _near(a: Cells, b: Cells, step: tuple[int, int]) -> bool:
    return abs(a[0] - b[0]) <= COUNTED_NEAR * step[0] and abs(a[1] - b[1]) <= COUNTED_NEAR * step[1]
