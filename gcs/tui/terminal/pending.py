"""Cells that a terminal is to show and was not sent yet: of every cell only the newest, text before pictures."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from textual._compositor import ChopsUpdate, CompositorUpdate, LayoutUpdate
from textual.strip import Strip

from gcs.tui.draw.cell_grid import CellRow

PICTURE_SEGMENTS = 0.4
"""Changes of colour a cell from which a row is a picture: half blocks have nearly 1, tables 0.2."""
TEXT_SHARE = 0.75
"""Part of a chunk that text may take while a picture waits: endless text may delay a picture, and never stop it."""

MIN_PIECE_BYTES = 512
"""A piece is not cut smaller than this."""


class PendingCells:
    """Pieces of rows, none over another, the eldest first; what is drawn again keeps its place and shows the newer."""

    def __init__(self) -> None:
        self._pieces: dict[tuple[int, int], Strip] = {}
        self._rows: dict[int, set[int]] = {}

    def __bool__(self) -> bool:
        return bool(self._pieces)

    @property
    def has_picture(self) -> bool:
        """True if a part of a picture still waits."""
        return any(map(_is_picture, self._pieces.values()))

    def clear(self) -> None:
        """Drop all that is pending."""
        self._pieces.clear()
        self._rows.clear()

    def add(self, update: CompositorUpdate) -> None:
        """Take what the compositor has drawn."""
        if isinstance(update, LayoutUpdate):
            self.clear()
        for y, x, strip in _pieces_of(update):
            if strip.cell_length:
                self._put(y, x, strip)

    def take(self, room: int, console: Console) -> str:
        """Control sequences for about ``room`` bytes of it, at least one piece; empty when nothing waits."""
        text: list[tuple[int, int]] = []
        picture: list[tuple[int, int]] = []
        for place, strip in self._pieces.items():
            (picture if _is_picture(strip) else text).append(place)
        parts: list[str] = []
        size = 0
        for places, limit in ((text, int(room * TEXT_SHARE) if picture else room), (picture, room), (text, room)):
            for place in places:
                if size >= limit:
                    break
                if place in self._pieces:
                    parts.append(self._render(place, max(limit - size, MIN_PIECE_BYTES), console))
                    size += len(parts[-1].encode())
        return "".join(parts)

    def _render(self, place: tuple[int, int], room: int, console: Console) -> str:
        """One piece, or as much of it as there is room for; the rest stays the eldest."""
        (y, x), strip = place, self._pop(place)
        cells = strip.render(console)
        fit = strip.cell_length * room // max(len(cells.encode()), 1)
        if 0 < fit < strip.cell_length and not _has_control(strip):
            rest = self._pieces
            self._pieces = {}
            self._keep(y, x + fit, strip.crop(fit))
            self._pieces.update(rest)
            cells = strip.crop(0, fit).render(console)
        return f"\x1b[{y + 1};{x + 1}H{cells}"

    def _put(self, y: int, x: int, strip: Strip) -> None:
        end = x + strip.cell_length
        for left in tuple(self._rows.get(y, ())):
            old = self._pieces[y, left]
            right = left + old.cell_length
            if left >= end or right <= x or (left, right) == (x, end):
                continue
            self._pop((y, left))
            if left < x:
                self._keep(y, left, old.crop(0, x - left))
            if right > end:
                self._keep(y, end, old.crop(end - left))
        self._keep(y, x, strip)

    def _keep(self, y: int, x: int, strip: Strip) -> None:
        self._pieces[y, x] = strip
        self._rows.setdefault(y, set()).add(x)

    def _pop(self, place: tuple[int, int]) -> Strip:
        self._rows[place[0]].discard(place[1])
        return self._pieces.pop(place)


def _is_picture(strip: Strip) -> bool:
    """Half blocks, or an image in the terminal's own format."""
    changes = strip.changes if isinstance(strip, CellRow) else len(strip._segments)
    return changes > PICTURE_SEGMENTS * strip.cell_length or _has_control(strip)


def _has_control(strip: Strip) -> bool:
    return not isinstance(strip, CellRow) and any(segment.control for segment in strip._segments)


def _pieces_of(update: CompositorUpdate) -> Iterator[tuple[int, int, Strip]]:
    """Row, column and cells of each piece of an update, as Textual's own ``render_segments`` walks through it."""
    if isinstance(update, LayoutUpdate):
        for y, line in enumerate(update.strips, update.region.y):
            x = update.region.x
            for strip in line:
                yield y, x, strip
                x += strip.cell_length
    elif isinstance(update, ChopsUpdate):
        for y, first, last in update.spans:
            for end, (x, chop) in zip(update.chop_ends[y], update.chops[y].items(), strict=False):
                if chop is not None and x <= last and end > first:
                    yield y, x, chop if first <= x < last and end <= last else chop.crop(0, min(end, last) - x)
