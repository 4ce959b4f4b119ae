"""Messages from panes to the app."""

from __future__ import annotations

from dataclasses import dataclass

from textual.message import Message

from gcs.snapshot import Alarm


@dataclass
class AlarmsSeen(Message):
    """The operator has acknowledged these."""

    alarms: tuple[Alarm, ...]


@dataclass
class VehiclePicked(Message):
    """The operator pointed at a vehicle or at a box without a name; both 0 for none."""

    system_id: int
    track_id: int = 0


@dataclass
class SeekTo(Message):
    """The operator pointed at a time of the recording."""

    t_us: int

    def can_replace(self, message: Message) -> bool:
        """Tell whether the message replaces an older one: only the newest request counts."""
        return isinstance(message, SeekTo)
