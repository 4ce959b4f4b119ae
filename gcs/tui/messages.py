"""What panes tell the app."""

from __future__ import annotations

from dataclasses import dataclass

from textual.message import Message

__all__ = ["SeekTo", "VehiclePicked"]


@dataclass
class VehiclePicked(Message):
    """The operator pointed at a vehicle; 0 for none."""

    system_id: int


@dataclass
class SeekTo(Message):
    """The operator pointed at a time of the recording."""

    t_us: int

    def can_replace(self, message: Message) -> bool:
        """Only the newest wish counts."""
        return isinstance(message, SeekTo)
