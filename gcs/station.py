"""Station that a screen drives: a live flight and a replay look the same from here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Alarm, Event, FleetChange, Snapshot
from gcs.trails import Trail
from mavlink.geodesy import LocalFrame
from mavlink.transmit.message_rates import Rate

SIMULATION_OVER: Final = "the simulated flight is over: names and places are of the past"
"""Sentence of screens and events once a simulated fleet has ended."""


class Commands(Protocol):
    """Orders of the operator to the UAV; both methods may be called from the screen's thread and return at once."""

    def orders(self, system_id: int) -> Sequence[tuple[str, str]]:
        """Orders that make sense while a vehicle is selected, 0 for none: a key for each, and words with its name."""

    def submit(self, key: str, system_id: int) -> None:
        """Carry an order out, which the operator has confirmed; what becomes of it comes as events.

        Raises:
            KeyError, ValueError: no such order, or not about this vehicle.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Newcomer:
    """A vehicle on the air that is not in the fleet."""

    system_id: int
    kind: str
    """Type of the vehicle in a word."""
    away_m: float
    """Distance over ground from the nearest vehicle of the fleet, m; inf unknown."""
    offered: bool
    """True if it may be one of ours: a ground vehicle that reports to be near, and that nobody has left out."""

    @property
    def offer(self) -> str:
        """Offer of it to the operator."""
        return f"{self.kind} {self.system_id} is heard, {self.away_m:.0f} m from the fleet: F takes it in"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPicture:
    """Picture of one of a flight's cameras as it is now."""

    name: str
    """Name of its aircraft or mast."""
    snapshot: Snapshot | None
    """Newest snapshot of the camera; None before the first."""
    on_show: bool
    """True of the camera that map, table and keys are about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """A part of a recording in which something was not received."""

    start_us: int
    stop_us: int
    what: Literal["telemetry", "video"]


class Timeline(Protocol):
    """The clock of a replay; every method may be called from the screen's thread and returns at once."""

    @property
    def start_us(self) -> int:
        """First moment of the recording."""

    @property
    def stop_us(self) -> int:
        """Last moment of the recording."""

    @property
    def now_us(self) -> int:
        """Present place."""

    @property
    def analysed(self) -> Sequence[tuple[int, int]]:
        """Parts that were worked out so far: first and last moment of each, in order."""

    @property
    def gaps(self) -> Sequence[Gap]:
        """Times when no frame or no telemetry was received, in order of time."""

    def confidence(self, system_id: int) -> NDArray[np.float32]:
        """(n,) least confidence in a vehicle's name in each of n equal parts of the recording; 0 while it has none, NaN
        where nothing was worked out yet."""

    def trails(self, t_us: int, span_s: float, origin: LocalFrame | None) -> Sequence[Trail]:
        """Places of vehicles in the seconds before a moment, as far as that was worked out, about an origin."""

    @property
    def playing(self) -> bool:
        """True if time runs."""

    @property
    def speed(self) -> float:
        """Speed as a multiple of real time."""

    def play(self) -> None:
        """Let time run."""

    def pause(self) -> None:
        """Stop time; the frame stays."""

    def seek(self, t_us: int) -> None:
        """Go to the frame at or before ``t_us``, clamped to the recording."""

    def step(self, frames: int) -> None:
        """Pause and move by frames, negative is back."""

    def set_speed(self, speed: float) -> None:
        """Set the speed, 0.1 to 20 times real time."""


class Practice(Protocol):
    """Troubles that a simulated fleet can be given."""

    @property
    def over(self) -> bool:
        """True once the simulated fleet has ended: all that is shown is of the past."""

    def troubles(self, system_id: int) -> Sequence[tuple[str, str]]:
        """Return a key and words for each that a vehicle may have, with whether it has it."""

    def toggle(self, key: str, system_id: int) -> None:
        """Begin or end one, and report it by an event."""


class Station(Protocol):
    """A running flight or replay."""

    @property
    def title(self) -> str:
        """Title of what flies or is replayed."""

    @property
    def timeline(self) -> Timeline | None:
        """None when live."""

    def next_view(self) -> Station | None:
        """The flight's next camera at the same moment, from now on the one on show; None where there is no other.

        Raises:
            GcsError, VisionError: what that one recorded cannot be used.
        """

    def pictures(self) -> Sequence[CameraPicture]:
        """Pictures of the flight's cameras as they are now, in the mission's order.

        Raises:
            GcsError, VisionError: what one of them recorded cannot be used.
        """

    @property
    def commands(self) -> Commands | None:
        """None for a station that listens only, and for a recording."""

    @property
    def practice(self) -> Practice | None:
        """None of a real fleet, and for a recording."""

    @property
    def error(self) -> BaseException | None:
        """Reason why it stopped by itself, None while all is well."""

    def latest(self) -> Snapshot | None:
        """The newest snapshot, None before the first."""

    def events(self) -> Sequence[Event]:
        """Events so far, oldest first, bounded in number."""

    @property
    def folder(self) -> Path | None:
        """Folder in which a flight keeps its files, and stills beside them; None for a recording."""

    @property
    def tiles(self) -> Path | None:
        """The MBTiles file that the mission has for the map, None without."""

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        """Keep the operator's note on a moment, as an event of kind ``mark``: a flight in ``events.jsonl``, a replay in
        a ``marks.jsonl`` of its own.

        Args:
            system_id: which vehicle it is about, 0 none.

        Raises:
            OSError: a replay cannot write it.
        """

    def add_event(self, event: Event) -> None:
        """Add something that the operator did to the event log; only a flight keeps it."""

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        """Note that the operator has seen these alarms; a flight keeps that in its events."""

    def state_name(self, track_id: int, system_id: int) -> None:
        """Take the operator's statement which vehicle a box is: evidence from the next frame on, kept in a flight's
        events.

        Args:
            system_id: of a ground vehicle of the mission; 0: none of ours.
        """

    def undo_statement(self, track_id: int = 0) -> None:
        """Withdraw what the operator stated of a track; of 0, what was stated last."""

    def rates(self) -> Sequence[Rate]:
        """Measured rates of the messages that a flight needs; none of a recording."""

    def newcomers(self) -> Sequence[Newcomer]:
        """Vehicles that are heard and not in the fleet; none of a recording."""

    def change_fleet(self, change: FleetChange) -> None:
        """Take a vehicle into the fleet, leave it out or rename it: from the next frame on, kept in a flight's events.

        Raises:
            ValueError: it cannot be done, and why not.
        """

    def accept_held(self, system_ids: Sequence[int]) -> None:
        """Accept vehicles whose signed packets are held, as the operator vouches for them; nothing in a recording."""

    def save_mission(self) -> str:
        """Write what flies as a mission file, never over one; return where, or why not.

        Raises:
            OSError: it cannot be written.
        """

    def take_rival_video(self) -> None:
        """Take the other video where two senders contest its port; nothing in a recording."""

    def stop(self) -> None:
        """End threads, seal the recording; safe to call twice."""
