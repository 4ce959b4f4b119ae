"""Stating by hand which vehicle the picked box is, and withdrawing it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

from textual.app import App
from textual.binding import Binding, BindingType

from gcs.certainty import certainty
from gcs.snapshot import Box, Snapshot
from gcs.station import Station
from gcs.tui.draw.format import metres
from gcs.tui.picking import Pick, picked_box
from gcs.tui.screens.choice import ChoiceList

RECORDING = "a recording takes no statements: those of the flight are in it"
NOTHING_PICKED = "pick a box first, by the arrow keys or a click"
NOT_TRACKED = "this box is not tracked yet: only what is seen in several frames can be named"
NONE_OF_OURS = "none of ours"


def ask_for_name(
    app: App[Any], station: Station, snapshot: Snapshot | None, pick: Pick, show: Callable[[int, int], None]
) -> None:
    """Let the operator state which vehicle the picked box is."""
    box = None if snapshot is None else picked_box(snapshot, *pick)
    if snapshot is None or box is None or not box.track_id or station.timeline is not None:
        why = RECORDING if station.timeline is not None else NOTHING_PICKED if box is None else NOT_TRACKED
        app.notify(why, severity="warning", timeout=6, markup=False)
        return
    track, names = box.track_id, {row.system_id: row.name for row in snapshot.vehicles}

    def state(key: str | None) -> None:
        if key is not None:
            system_id = int(key)
            station.state_name(track, system_id)
            name = names[system_id] if system_id else NONE_OF_OURS
            app.notify(f"stated: track {track} is {name}; backspace withdraws it", timeout=4, markup=False)
            show(system_id, track)

    app.push_screen(NameList(f"Which vehicle is track {track}?", choices_of(snapshot, box)), state)


def withdraw_name(app: App[Any], station: Station, snapshot: Snapshot | None, pick: Pick) -> None:
    """Withdraw the statement about the picked box, else the latest."""
    if station.timeline is not None:
        app.notify(RECORDING, severity="warning", timeout=6, markup=False)
        return
    box = None if snapshot is None else picked_box(snapshot, *pick)
    station.undo_statement(box.track_id if box is not None and box.stated else 0)


def choices_of(snapshot: Snapshot, box: Box) -> list[tuple[str, str]]:
    """System ids and words: the present name, the candidates as they are likely, all others, and none of ours."""
    known = {each.system_id: each for each in box.candidates}
    fleet = [row for row in snapshot.vehicles if row.role == "ugv"]
    order = {system_id: place for place, system_id in enumerate(known)}
    fleet.sort(key=lambda row: (row.system_id != box.system_id, order.get(row.system_id, len(order))))
    choices = []
    for row in fleet:
        words = ["the present name"] if row.system_id == box.system_id else []
        if row.system_id in known:
            candidate = known[row.system_id]
            away = metres(candidate.distance_m) if math.isfinite(candidate.distance_m) else ""
            words += [certainty(candidate.confidence), away, candidate.against]
        choices.append((str(row.system_id), f"{row.name:<10} {', '.join(word for word in words if word != '')}"))
    return [*choices, ("0", NONE_OF_OURS)]


class NameList(ChoiceList):
    """The vehicles that a box may be stated to be."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,equals_sign", "cancel", "Cancel", id="names.cancel", tooltip="Close without a statement"),
    ]

    def __init__(self, title: str, choices: list[tuple[str, str]]) -> None:
        hint = "enter states it, as evidence that reports can contradict; esc closes"
        super().__init__(title, choices, hint)
