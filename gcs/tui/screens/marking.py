"""A mark with a text at the moment at which the operator asked for it."""

from __future__ import annotations

from typing import Any

from textual.app import App

from gcs.snapshot import Snapshot
from gcs.station import Station
from gcs.tui.draw.format import clock
from gcs.tui.screens.prompts import Prompt
from infra.plain_text import plain
from infra.wall_clock import now_us

LONGEST = 200
"""Letters of a mark: a line of the log, not a report."""
NO_WORDS = "mark"
NOT_SERVED = "screens in a browser write nothing on this computer: mark it in gcs replay on a terminal"


def ask_for_mark(app: App[Any], station: Station, snapshot: Snapshot | None, selected: int) -> None:
    """Ask for a line of text and keep it with the time of now, however long the typing takes.

    Args:
        app: to show the question.
        station: keeps the mark.
        snapshot: the newest, None before the first.
        selected: system id of the selected vehicle, which the mark is about; 0 none.
    """
    if app.is_web:
        app.notify(NOT_SERVED, severity="warning", timeout=6, markup=False)
        return
    t_us = now_us() if station.timeline is None else station.timeline.now_us
    about = f" about {plain(snapshot.name_of(selected))}" if selected and snapshot is not None else ""

    def keep(text: str) -> str:
        words = plain(text).strip()[:LONGEST] or NO_WORDS
        station.mark(t_us, words, selected)
        return words

    ask = Prompt(f"Mark {clock(t_us, tenths=True)}{about}", "what is to be remembered of this moment", keep)
    app.push_screen(ask, lambda words: None if words is None else app.notify(f"marked: {words}", markup=False))
