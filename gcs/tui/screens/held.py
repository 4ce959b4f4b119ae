"""Vouching for vehicles whose signed packets are held: who they are, how far behind, asked once more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from textual.app import App

from gcs.snapshot import Snapshot, VehicleRow
from gcs.station import Station
from gcs.tui.draw.format import age
from gcs.tui.screens.prompts import Confirm
from infra.plain_text import plain

NONE_HELD = "no vehicle has signed packets that are held"
RECORDING = "a recording accepts no vehicle: what was held stays held"


def held_rows(snapshot: Snapshot | None, selected: int) -> tuple[VehicleRow, ...]:
    """Vehicles whose packets are held: the selected one if it is among them, else all."""
    rows = tuple(row for row in snapshot.vehicles if not math.isnan(row.held_s)) if snapshot else ()
    return tuple(row for row in rows if row.system_id == selected) or rows


def ask_to_accept(app: App[Any], station: Station, snapshot: Snapshot | None, selected: int) -> None:
    """Let the operator accept what is held.

    Args:
        app: to show the question.
        station: takes the answer.
        snapshot: the newest.
        selected: system id of the selected vehicle, 0 for none.
    """
    rows = held_rows(snapshot, selected)
    if not rows or station.timeline is not None:
        app.notify(NONE_HELD if station.timeline is None else RECORDING, severity="warning", timeout=6, markup=False)
        return
    question = f"Accept {_who(rows)}, though nothing proves that it is no recording"

    def accept(yes: bool | None) -> None:
        if yes:
            station.accept_held([row.system_id for row in rows])

    app.push_screen(Confirm(question), accept)


def _who(rows: Sequence[VehicleRow]) -> str:
    return ", ".join(f"{plain(row.name)} ({age(row.held_s)} behind)" for row in rows)
