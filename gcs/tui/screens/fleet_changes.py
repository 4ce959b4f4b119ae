"""Changing the fleet in flight: who is heard is taken in, who is in it left out or called otherwise."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, ClassVar

from textual.app import App
from textual.binding import Binding, BindingType
from textual.widgets import OptionList

from gcs.snapshot import FleetChange, Snapshot
from gcs.station import Newcomer, Station
from gcs.tui.draw.format import metres
from gcs.tui.screens.choice import ChoiceList
from gcs.tui.screens.prompts import Prompt
from infra.plain_text import plain

OFFER_S = 20.0


def ask_for_fleet(app: App[Any], station: Station, snapshot: Snapshot | None) -> None:
    """Let the operator change who is in the fleet."""
    if snapshot is None:
        return
    names = {row.system_id: row.name for row in snapshot.vehicles}

    def change(key: str | None) -> None:
        if key is None:
            return
        what, _, number = key.rpartition(" ")
        system_id = int(number)
        if what == "rename":
            _ask_for_name(app, station, system_id, names.get(system_id, ""))
            return
        what_now = "left out" if system_id in names else "added"
        _change(app, station, FleetChange(what=what_now, system_id=system_id))  # type: ignore[arg-type]

    app.push_screen(FleetList(_choices(snapshot, station.newcomers())), change)


def tell_newcomers(app: App[Any], newcomers: Sequence[Newcomer], known: Collection[int]) -> frozenset[int]:
    """Notify once of each vehicle that is offered for the fleet; return the ids of all notified of."""
    offered = frozenset(each.system_id for each in newcomers if each.offered)
    for each in newcomers:
        if each.offered and each.system_id not in known:
            app.notify(each.offer, timeout=OFFER_S, markup=False)
    return offered | frozenset(known)


class FleetList(ChoiceList):
    """Everyone who is in the fleet or heard."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,q,F", "cancel", "Cancel", id="fleet.cancel", tooltip="Close without a change"),
        Binding("space", "choose", "In or out", id="fleet.toggle", tooltip="Take it in, or leave it out"),
        Binding("r", "rename", "Rename", id="fleet.rename", tooltip="Call it otherwise"),
    ]

    def __init__(self, choices: list[tuple[str, str]]) -> None:
        super().__init__("Who is in the fleet?", choices, "enter takes in or leaves out; r renames; esc closes")

    def action_choose(self) -> None:
        """Choose, as enter does."""
        self.query_one(OptionList).action_select()

    def action_rename(self) -> None:
        """Hand over who is to be called otherwise."""
        option = self.query_one(OptionList).highlighted_option
        if option is not None:
            self.dismiss(f"rename {option.id}")


def _choices(snapshot: Snapshot, newcomers: Sequence[Newcomer]) -> list[tuple[str, str]]:
    """System ids and words: who may be taken in first, since that is what the list is opened for."""
    rows = [
        (each.system_id, "–", f"{each.kind}, heard{'' if math.isinf(each.away_m) else f' {metres(each.away_m)} away'}")
        for each in sorted(newcomers, key=lambda each: (not each.offered, each.away_m, each.system_id))
    ]
    rows += [(row.system_id, row.name, "films" if row.role == "uav" else "in the fleet") for row in snapshot.vehicles]
    return [(str(system_id), f"{system_id:>3} {name:<14} {words}") for system_id, name, words in rows]


def _ask_for_name(app: App[Any], station: Station, system_id: int, value: str) -> None:
    def rename(name: str | None) -> None:
        if name is not None:
            _change(app, station, FleetChange(what="renamed", system_id=system_id, name=name))

    prompt = Prompt(f"Name of vehicle {system_id}", "nothing: as without a name", _name, value=value)
    app.push_screen(prompt, rename)


def _name(text: str) -> str:
    return plain(text.strip())


def _change(app: App[Any], station: Station, change: FleetChange) -> None:
    """Make a change, or say why it cannot be made; what became of it is an event."""
    try:
        station.change_fleet(change)
    except ValueError as error:
        app.notify(str(error), severity="warning", timeout=6, markup=False)
