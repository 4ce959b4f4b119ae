"""Lines of cells: styled parts to Textual strips, cropped and padded to an exact width."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.cells import cell_len, chop_cells, set_cell_size
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip

from gcs.tui.palette import HEAD, INK, LINE, PANEL, ink
from gcs.tui.themes import Colour

Part = tuple[str, Style]
"""Plain text and how it looks; the text must already be free of control characters."""
NO_BREAK = "\N{NO-BREAK SPACE}"


def line(parts: Iterable[Part], width: int, paper: Colour = PANEL) -> Strip:
    """A strip of exactly ``width`` cells."""
    segments = [Segment(text, style) for text, style in parts if text]
    cells = sum(cell_len(text) for text, _, _ in segments)
    if cells < width:
        segments.append(Segment(" " * (width - cells), ink(paper=paper)))
    return Strip(segments, max(cells, width)).adjust_cell_length(width)


def blank(width: int, paper: Colour = PANEL) -> Strip:
    """A strip of background."""
    return Strip([Segment(" " * width, ink(paper=paper))], width)


def clickable(part: Part, action: str) -> Part:
    """Return the part with an action of Textual that runs when it is clicked."""
    text, style = part
    return text, style + Style.from_meta({"@click": action})


def width_of(parts: Iterable[Part]) -> int:
    """Cells that parts take."""
    return sum(cell_len(text) for text, _ in parts)


def split_line(
    left: Sequence[Part], right: Sequence[Part], width: int, paper: Colour = HEAD, *, rule: bool = False
) -> Strip:
    """Parts at both ends of one strip; the right end is dropped when there is no room.

    Args:
        left: Parts.
        right: Parts.
        width: Cells.
        paper: Background.
        rule: Draw a line between them: a heading is one without its background too.
    """
    gap = width - width_of(left) - width_of(right)
    if gap < 1:
        left, right, gap = left, (), max(0, width - width_of(left))
    between = "─" * (gap - 1) + " " if rule and gap > 1 else " " * gap
    return line([*left, (between, ink(LINE if rule else INK, paper)), *right], width, paper)


def fitted(text: str, width: int, align: str = "left") -> str:
    """Text cut with an ellipsis or padded to exactly ``width`` cells."""
    size = cell_len(text)
    if size > width:
        return set_cell_size(text, width - 1) + "…" if width > 0 else ""
    return " " * (width - size) + text if align == "right" else text + " " * (width - size)


def cut_between_words(text: str, width: int, names: Iterable[str] = ()) -> str:
    """Text of at most ``width`` cells; of a longer one the first words, and an ellipsis.

    Args:
        text: One line.
        width: Cells.
        names: Words that belong together: a part of a name may be another one.
    """
    if cell_len(text) <= width:
        return text
    end = len(set_cell_size(text, max(0, width - 2)).rstrip())
    end = max(text.rfind(" ", 0, end + 1), 0) or end
    for name in names:
        start = text.rfind(name, 0, end + len(name))
        if start >= 0 and start < end < start + len(name):
            end = start
    return f"{text[:end].rstrip()} …" if width > 1 else fitted(text, width)


def folded(text: str, width: int, names: Iterable[str] = ()) -> list[str]:
    """Text in lines of at most ``width`` cells, at least one, broken between words; only longer words are cut.

    Args:
        text: One line.
        width: Cells.
        names: Words that belong together: a part of a name may be another one.
    """
    for name in names:
        text = text.replace(name, name.replace(" ", NO_BREAK))
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if cell_len(longer) <= width:
            lines[-1] = longer
        else:
            lines += chop_cells(word, width)
    return [each.replace(NO_BREAK, " ").rstrip() for each in lines if each] or [""]


def bar(share: float, width: int) -> str:
    """A horizontal bar of eighths of a cell, ``share`` 0..1, NaN empty."""
    eighths = round(8 * width * min(max(share, 0.0), 1.0)) if share == share else 0
    full, rest = divmod(eighths, 8)
    return ("█" * full + (" ▏▎▍▌▋▊▉"[rest] if rest else "")).ljust(width)
