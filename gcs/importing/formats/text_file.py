"""Text files from other programs, a line at a time: any common encoding, any end of line, bounded memory."""

from __future__ import annotations

import codecs
import os
from collections.abc import Generator, Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO, TextIO

from gcs.errors import ImportFileError
from infra.files.safe_open import open_to_read

MAX_LINE_CHARS = 1 << 16
"""Length of the longest line of any subtitle or table: what reads DJI's own records names hundreds of columns."""
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
LOOKED_AT = 4096
"""Bytes at the beginning of a file that tell what it is."""


def open_file(path: Path) -> BinaryIO:
    """Open a regular file of others.

    Raises:
        ImportFileError: no such file, empty, or not readable.
    """
    try:
        file = os.fdopen(open_to_read(path), "rb")
    except FileNotFoundError:
        raise ImportFileError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # a name with a NUL in it is a ValueError
        raise ImportFileError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if os.fstat(file.fileno()).st_size == 0:
        file.close()
        raise ImportFileError(f"{path}: the file is empty")
    return file


def text_lines(path: Path) -> Generator[str]:
    """Lines without their ends; one that is too long is cut, its rest is left out.

    Raises:
        ImportFileError: it cannot be opened.
    """
    with open_file(path) as raw:
        head = raw.read(LOOKED_AT)
        encoding = next((name for mark, name in _MARKS if head.startswith(mark)), _guess(head))
    with os.fdopen(open_to_read(path), encoding=encoding, errors="replace") as file:
        yield from _lines(file)


def _guess(head: bytes) -> str:
    """UTF-16 has a zero byte in each Latin letter; anything else is UTF-8 or a superset of ASCII."""
    if len(head) >= 4 and head[1::2].count(0) > len(head) // 4:
        return "utf-16-le"
    if len(head) >= 4 and head[0::2].count(0) > len(head) // 4:
        return "utf-16-be"
    return "utf-8"


def _lines(file: TextIO) -> Iterator[str]:
    pieces = iter(partial(file.readline, MAX_LINE_CHARS), "")
    for line in pieces:
        kept = line
        while line and not line.endswith("\n") and len(line) >= MAX_LINE_CHARS:
            line = next(pieces, "")
        yield kept.rstrip("\r\n")
