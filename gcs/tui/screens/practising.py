"""Choosing a trouble of a simulated fleet, to practise with."""

from __future__ import annotations

from typing import Any

from textual.app import App

from gcs.snapshot import Snapshot
from gcs.station import Station
from gcs.tui.screens.choice import ChoiceList

REAL = "troubles are for simulated fleets: gcs demo --live, or gcs fly --practise"


def ask_for_trouble(app: App[Any], station: Station, snapshot: Snapshot | None, selected: int) -> None:
    """Let the operator begin or end a trouble of the picked vehicle, else of the first ground vehicle.

    Args:
        app: to show the list.
        station: asks the fleet for it.
        snapshot: the newest.
        selected: system id of the picked vehicle, 0 for none.
    """
    practice = station.practice
    if practice is None:
        app.notify(REAL, severity="warning", timeout=6, markup=False)
        return
    fleet = {row.system_id: row.name for row in snapshot.vehicles} if snapshot else {}
    grounded = [row.system_id for row in snapshot.vehicles if row.role == "ugv"] if snapshot else []
    system_id = selected if selected in fleet else next(iter(grounded), 0)

    def toggle(key: str | None) -> None:
        if key is not None:
            practice.toggle(key, system_id)

    if system_id:
        title = f"Which trouble is {fleet[system_id]} to have?"
        app.push_screen(ChoiceList(title, practice.troubles(system_id), "enter begins or ends it; esc closes"), toggle)
