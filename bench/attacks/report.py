"""Rows of results, as a table and as a file to compare with later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from infra.markdown import markdown_table

NAN = math.nan
MOST_TEXT = 110


@dataclass(frozen=True, slots=True, kw_only=True)
class AttackRow:
    """What became of one case of an attack."""

    attack: str
    case: str
    sent: int = 0
    """Packets of the true vehicles."""
    lost: int = 0
    """Of those, not recorded or, with keys, refused."""
    false_sent: int = 0
    false_recorded: int = 0
    believed_s: float = NAN
    """For how long something false was accepted that could have been known to be false."""
    alarm_s: float = NAN
    """From when it could be known to the alarm; NaN: none came, or none was due."""
    held: bool
    note: str = ""

    @property
    def summary(self) -> str:
        """For the column of an earlier run."""
        words = [] if self.held else ["not held"]
        words += [f"{self.lost:,} lost"] if self.lost else []
        words += [f"believed {self.believed_s:.1f} s"] if self.believed_s > 0 else []
        words += [f"alarm {self.alarm_s:.1f} s"] if math.isfinite(self.alarm_s) else []
        words += [self.note] if self.note else []
        return "; ".join(words) or "held"


HEAD = (
    "attack",
    "case",
    "true sent",
    "lost",
    "false sent",
    "recorded",
    "false believed",
    "alarm after",
    "verdict",
    "note",
)


def page(rows: Sequence[AttackRow], title: str, words: str, before: Sequence[AttackRow] = ()) -> str:
    """A Markdown page.

    Args:
        rows: the results.
        title: heading.
        words: text between heading and table.
        before: results of an earlier build; gives a column more.
    """
    then = {(row.attack, row.case): row for row in before}
    head = [*HEAD, *(["before"] if before else [])]
    lines = []
    for row in rows:
        cells = [
            row.attack,
            row.case,
            _count(row.sent),
            _count(row.lost) if row.sent else "–",
            _count(row.false_sent),
            _count(row.false_recorded) if row.false_sent else "–",
            _seconds(row.believed_s),
            _seconds(row.alarm_s),
            "held" if row.held else "**not held**",
            row.note,
        ]
        if before:
            earlier = then.get((row.attack, row.case))
            cells.append(earlier.summary if earlier else "–")
        lines.append(list(map(_cell, cells)))
    held = sum(row.held for row in rows)
    return f"# {title}\n\n{words.strip()}\n\n{markdown_table(head, lines)}\n\n{held} of {len(rows)} cases held.\n"


def _cell(text: str) -> str:
    """As a cell of a table; an event's text is cut where addresses begin to fill it."""
    return text if len(text) <= MOST_TEXT else text[:MOST_TEXT].rstrip() + " …"


def _count(number: int) -> str:
    return f"{number:,}" if number else "0"


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if math.isfinite(value) else "–"
