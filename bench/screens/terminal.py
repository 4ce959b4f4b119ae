"""A small terminal: what a program writes becomes rows of letters with their looks, as far as Textual needs it."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass

from rich.cells import cell_len

TOKEN = re.compile(
    r"\x1b\[(?P<parameters>[0-?]*)[ -/]*(?P<final>[@-~])"  # CSI
    r"|\x1b[\]PX^_].*?(?:\x07|\x1b\\)"  # strings to the terminal: titles, images
    r"|\x1b[^\[\]PX^_]"
    r"|(?P<text>[^\x00-\x1f\x7f]+)"
    r"|[\x00-\x1a\x1c-\x1f\x7f]",
    re.DOTALL,
)
FOREGROUND, BACKGROUND = "38", "48"


@dataclass(frozen=True, slots=True)
class Cell:
    """A letter and how it looks."""

    letter: str = " "
    look: tuple[str, ...] = ()
    """SGR parameters that are in effect: foreground, background, then flags."""


BLANK = Cell()


class TerminalScreen:
    """Cells, and where the next letter goes.

    Attributes:
        cells: rows of cells; the right half of a wide letter has an empty one.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.columns, self.rows = columns, rows
        self.cells = [[BLANK] * columns for _ in range(rows)]
        self._x = self._y = 0
        self._look: dict[str, str] = {}
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._rest = ""

    @property
    def text(self) -> str:
        """All rows."""
        return "\n".join("".join(cell.letter for cell in row) for row in self.cells)

    def feed(self, data: bytes) -> None:
        """Take in what the program wrote."""
        text = self._rest + self._decoder.decode(data)
        end = 0
        for match in TOKEN.finditer(text):
            if match.start() > end:  # a sequence that is not whole yet
                break
            end = match.end()
            if match["text"]:
                self._write(match["text"])
            elif match["final"]:
                self._control(match["parameters"], match["final"])
            elif match[0] in "\r\n\b":
                self._move(match[0])
        self._rest = text[end:]

    def _move(self, control: str) -> None:
        if control == "\r":
            self._x = 0
        elif control == "\n":
            self._y = min(self._y + 1, self.rows - 1)
        else:
            self._x = max(self._x - 1, 0)

    def _write(self, text: str) -> None:
        look = tuple(self._look.values())
        for letter in text:
            width = cell_len(letter)
            if self._y < self.rows and self._x + width <= self.columns and width:
                row = self.cells[self._y]
                row[self._x] = Cell(letter, look)
                if width == 2:
                    row[self._x + 1] = Cell("", look)
            self._x += width

    def _control(self, parameters: str, final: str) -> None:
        if final == "m":
            self._restyle(parameters.split(";"))
            return
        if not parameters.replace(";", "").isdigit() and parameters:
            return  # modes and questions
        numbers = [int(part) if part else 0 for part in parameters.split(";")]
        if final in "Hf":
            self._y = max(numbers[0], 1) - 1
            self._x = max(numbers[1] if len(numbers) > 1 else 1, 1) - 1
        elif final == "J" and numbers[0] == 2:
            self.cells = [[BLANK] * self.columns for _ in range(self.rows)]
        elif final == "K" and self._y < self.rows:
            self.cells[self._y][self._x :] = [BLANK] * (self.columns - min(self._x, self.columns))
        elif final in "ABCD":
            steps = max(numbers[0], 1)
            self._x += steps * ((final == "C") - (final == "D"))
            self._y += steps * ((final == "B") - (final == "A"))

    def _restyle(self, parts: list[str]) -> None:
        at = 0
        while at < len(parts):
            part = parts[at].lstrip("0")
            if part in (FOREGROUND, BACKGROUND) and at + 1 < len(parts):
                size = 5 if parts[at + 1] == "2" else 3
                self._look[part] = ";".join(parts[at : at + size])
                at += size
                continue
            if not part:
                self._look.clear()
            elif part in ("39", "49"):
                self._look.pop("38" if part == "39" else "48", None)
            else:
                self._look[part] = part
            at += 1
