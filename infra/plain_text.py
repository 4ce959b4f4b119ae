"""The one rule for words that are not ours (names, reasons, paths, texts from the air) wherever they leave the program.

Screens, stdout, stderr, logs, tables, films: a terminal takes orders in control characters, a reader is deceived by
characters that turn the direction of writing or end a line.
"""

from __future__ import annotations

_FORMULA = tuple("=+-@＝＋－＠")
"""A cell that begins so is run by spreadsheets; those that count wide letters as their narrow twins too."""
_AS_TEXT = "'"
"""Spreadsheets take what follows for text and do not show it."""


def plain(text: str) -> str:
    """One line of as many letters, those that cannot be printed replaced by U+FFFD.

    Cannot be printed: control, format, surrogate, private and unassigned characters, ends of lines, and every space
    but the common one.

    Example:
        >>> plain("Alpha") == "Alpha"
        True
        >>> plain("a" + chr(0x9B) + "b") == "a" + chr(0xFFFD) + "b"
        True
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def to_cell(text: str) -> str:
    """Words as a cell of a table that spreadsheets open: one plain line, never a formula. Numbers go in as they are."""
    text = plain(text)
    return _AS_TEXT + text if text.lstrip(" " + _AS_TEXT).startswith(_FORMULA) else text


def from_cell(cell: str) -> str:
    """Return the words of a cell."""
    text = cell.removeprefix(_AS_TEXT)
    return text if to_cell(text) == cell else cell
