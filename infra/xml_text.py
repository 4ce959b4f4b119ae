"""Reader of XML from other programs, an element at a time: within bounds, and without entities, which may expand to any
size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import BinaryIO, Protocol
from xml.parsers import expat

MAX_DEPTH = 64
_CHUNK = 1 << 16

ElementHandler = Callable[[Sequence[str], Mapping[str, str], str], None]
"""Takes the names from the outermost element to this one, without prefixes, its attributes, and its own text."""


class LineKeeper(Protocol):
    """Target of an XML parser that keeps the line at which an element ends."""

    line: int


class XmlRefusedError(ValueError):
    """XML is refused; the message, one line, says why."""


class _Elements:
    """Handler of the parser's events: it keeps the names, attributes and texts of the elements that are open."""

    def __init__(self, ended: ElementHandler, most_text: int, lines: LineKeeper | None) -> None:
        self._ended, self._most_text, self._lines = ended, most_text, lines
        self.parser = expat.ParserCreate()
        self._names: list[str] = []
        self._attributes: list[dict[str, str]] = []
        self._texts: list[str] = []

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self._names) >= MAX_DEPTH:
            raise XmlRefusedError(f"it is nested more than {MAX_DEPTH} deep")
        self._names.append(tag.rpartition(":")[2])
        self._attributes.append(attributes)
        self._texts.append("")

    def text(self, data: str) -> None:
        if len(self._texts[-1]) < self._most_text:
            self._texts[-1] = (self._texts[-1] + data)[: self._most_text]

    def end(self, _tag: str) -> None:
        if self._lines is not None:
            self._lines.line = self.parser.CurrentLineNumber
        self._ended(self._names, self._attributes[-1], self._texts[-1])
        self._names.pop()
        self._attributes.pop()
        self._texts.pop()

    def refuse(self, *_: object) -> None:
        raise XmlRefusedError("it has a document type definition, which is not read")


def read_elements(file: BinaryIO, ended: ElementHandler, most_text: int, lines: LineKeeper | None = None) -> str:
    """Call a handler at the end of each element.

    Args:
        file: bytes in any encoding that XML has.
        ended: may raise whatever it likes but ``ValueError`` and ``LookupError``.
        lines: gets the line of each element's end before the handler is called.

    Returns:
        Why the document ends before its time, in one line; empty if it is whole.

    Raises:
        XmlRefusedError: it has a document type definition, or is nested too deeply.
    """
    elements = _Elements(ended, most_text, lines)
    parser = elements.parser
    parser.StartElementHandler, parser.EndElementHandler = elements.start, elements.end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = elements.text, elements.refuse
    parser.buffer_text = True
    try:
        while chunk := file.read(_CHUNK):
            parser.Parse(chunk, False)
        parser.Parse(b"", True)
    except XmlRefusedError:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:
        return " ".join(str(error).split())
    return ""
