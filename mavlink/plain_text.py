"""The one rule for words that are not ours (names, reasons, paths, texts from the air) wherever they leave the program.

Screens, stdout, stderr, logs, tables, films: a terminal takes orders in control characters, a reader is deceived by
characters that turn the direction of writing or end a line.
"""

from __future__ import annotations

__all__ = ["plain"]


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
