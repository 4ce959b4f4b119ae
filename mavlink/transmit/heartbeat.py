"""Frames that the station sends on its own once it commands: its heartbeat, and requests for the UAV's clock.

Both are sent by polling in the caller's loop, so that a program that hangs falls silent. What was missed is not sent
later.
"""

from __future__ import annotations

from mavlink.protocol.encoder import GCS, NO_AUTOPILOT, MavlinkEncoder

HEARTBEAT_S = 1.0
"""The rate that MAVLink's heartbeat protocol asks for."""
TIMESYNC_S = 7.0
"""Often enough for a drift within minutes, and no multiple of the heartbeat's."""


class HeartbeatTimer:
    """One HEARTBEAT a second while it is polled.

    Args:
        encoder: this station's; not as 255, or the vehicle's failsafe would take us for its first station.
    """

    def __init__(self, encoder: MavlinkEncoder) -> None:
        self._encoder = encoder
        self._due_s = 0.0

    def poll(self, now_s: float) -> bytes | None:
        """The heartbeat when one is due."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + HEARTBEAT_S
        return self._encoder.heartbeat(GCS, autopilot=NO_AUTOPILOT, armed=False)


class TimeSyncTimer:
    """A TIMESYNC request every few seconds; :mod:`mavlink.estimation.clock_health` reads the answers."""

    def __init__(self, encoder: MavlinkEncoder) -> None:
        self._encoder = encoder
        self._due_s = 0.0

    def poll(self, now_s: float, unix_ns: int) -> bytes | None:
        """A request when one is due: tc1 = 0, ts1 = our clock."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + TIMESYNC_S
        return self._encoder.timesync(0, unix_ns)
