"""Notices of the fleet as events: a vehicle's own words are marked as such, with the sender."""

from __future__ import annotations

from gcs.mission.mission import Mission
from gcs.snapshot import Event
from mavlink.protocol.packet import Auth, Packet
from mavlink.state import FleetState, Notice


class NoticeEvents:
    """Makes events of one mission's notices."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._contested: frozenset[int] = frozenset()
        self._verifies = False

    def follow(self, state: FleetState) -> None:
        """Take note of whose senders are in doubt."""
        self._contested = state.contested
        self._verifies = any(status.signed for status in state.vehicles)

    def event(self, notice: Notice, packet: Packet) -> Event:
        """A notice that a packet led to as an event."""
        text = f"{self._speaker(packet)} says: {notice.text}" if notice.kind == "text" else notice.text
        return Event(t_us=notice.t_us, level=notice.level, kind=notice.kind, text=text, system_id=notice.system_id)

    def _speaker(self, packet: Packet) -> str:
        """The vehicle whose system id it is, with what speaks against its being the sender."""
        name = self.mission.name_of(packet.system_id)
        if packet.system_id in self._contested:
            return f"{name} (contested)"
        # where nothing is authenticated, that is said once for all
        return f"{name} (unsigned)" if self._verifies and packet.auth is not Auth.GOOD else name
