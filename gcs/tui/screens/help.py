"""The help screen: every key in a word, and what the marks and colours mean, in pages that fit the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.geometry import Size
from textual.screen import ModalScreen
from textual.strip import Strip
from textual.widget import Widget

from gcs.tui.actions import Action
from gcs.tui.draw.strips import Part, blank, fitted, folded, line, split_line
from gcs.tui.palette import ACCENT, BRIGHT, FAINT, HEAD, INK, ink
from gcs.tui.screens.legend import LEGEND
from gcs.tui.themes import Colour

KEY_CELLS: Final = 12
COLUMN_CELLS: Final = 58
"""A second column comes with twice this width."""
Entry = tuple[str, Colour, str]
"""A key or sign, its colour, and what it is."""
Block = tuple[str, list[Entry]]


def pages(blocks: Iterable[Block], columns: int, width: int, height: int) -> list[list[list[list[Part]]]]:
    """Blocks of entries in pages of columns of lines, no text cut.

    Args:
        blocks: Heading and entries each; one that goes on in the next column repeats its heading.
        columns: On a page, above 0.
        width: Of a column, cells.
        height: Of a page, rows, above 1.
    """
    filled: list[list[list[Part]]] = [[]]
    for title, entries in blocks:
        heading: list[Part] = [(title, ink(ACCENT, bold=True))]
        for at, entry in enumerate(entries):
            lines = list(_lines(entry, width))
            column = filled[-1]
            if len(column) + len(lines) + (at == 0) > height and column:
                filled.append([heading, *lines])
            else:
                column += [heading, *lines] if at == 0 else lines
    return [filled[first : first + columns] for first in range(0, len(filled), columns)]


def _lines(entry: Entry, width: int) -> Iterator[list[Part]]:
    sign, colour, words = entry
    first, *more = folded(words, max(1, width - KEY_CELLS - 3))
    yield [(f"  {fitted(sign, KEY_CELLS)} ", ink(colour)), (first, ink(INK))]
    for text in more:
        yield [(" " * (KEY_CELLS + 3), ink(INK)), (text, ink(INK))]


class HelpPage(Widget):
    """One page at a time, under a heading and over a row that says how to turn."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        """Show help."""
        super().__init__(id="help")
        self._blocks = blocks
        self._pages: list[list[list[list[Part]]]] = []
        self._pages_size: Size | None = None
        self._at = 0

    @property
    def pages(self) -> list[list[list[list[Part]]]]:
        """Pages for the size as it is now, folded once: each row asks for them."""
        if self._pages_size != self.size:
            columns = max(1, min(2, self.size.width // COLUMN_CELLS))
            width, height = self.size.width // columns - 3, max(2, self.size.height - 2)
            self._pages, self._pages_size = pages(self._blocks, columns, width, height), self.size
        return self._pages

    def turn(self, steps: int) -> None:
        """Turn to another page; after the last comes the first."""
        self._at = (self._at + steps) % len(self.pages)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """A row of the page."""
        width, height = self.size
        count = len(self.pages)
        self._at = min(self._at, count - 1)
        if y == 0:
            number = [(f"page {self._at + 1} of {count} ", ink(BRIGHT, HEAD))]
            return split_line([(" HELP", ink(ACCENT, HEAD, bold=True))], number, width)
        if y == height - 1:
            keys = " ? or → next page   ← page before   esc closes"
            return line([(keys, ink(FAINT, HEAD))], width, HEAD)
        columns = self.pages[self._at]
        each = width // max(1, min(2, width // COLUMN_CELLS))
        strips = [line([(" ", ink()), *(rows[y - 1] if y <= len(rows) else [])], each) for rows in columns]
        rest = width - each * len(strips)
        return Strip.join([*strips, blank(rest)]) if rest else Strip.join(strips)

    def on_click(self, event: events.Click) -> None:
        """The next page; from the left quarter the one before."""
        self.turn(-1 if event.x < self.size.width // 4 else 1)


class HelpScreen(ModalScreen[None]):
    """Screen with all keys and marks; leave with ``esc``, ``q`` or ``enter``."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,enter", "dismiss", "Close", id="help.close", tooltip="Close the help"),
        Binding("question_mark,right,down,space,pagedown,l,j", "turn(1)", "Next", id="help.next", tooltip="Next page"),
        Binding("left,up,pageup,h,k", "turn(-1)", "Before", id="help.previous", tooltip="Page before"),
    ]

    def __init__(self, actions: Iterable[Action]) -> None:
        """Show help."""
        super().__init__()
        self._page = HelpPage(_blocks(actions))

    def compose(self) -> ComposeResult:
        """Yield the page."""
        yield self._page

    def action_turn(self, steps: int) -> None:
        """Turn to another page."""
        self._page.turn(steps)


def _blocks(actions: Iterable[Action]) -> list[Block]:
    """Keys by group, then marks and colours."""
    keys: list[Block] = [
        (title, [(action.keys, BRIGHT, action.words) for action in group])
        for title, group in groupby(actions, key=lambda action: action.group)
    ]
    return [*keys, *LEGEND]
