"""The component of a system that is the vehicle's autopilot, and who reports the vehicle's place.

Companions, gimbals and payload computers share the autopilot's system id and may send heartbeats and positions too. The
autopilot sends an autopilot's heartbeat, and by the standard its component id is 1. None of this is a proof: where two
components contradict each other, neither is used (:mod:`mavlink.duplicate_id.duplicate_id`).
"""

from __future__ import annotations

from typing import NamedTuple

from mavlink.protocol.messages import Heartbeat
from mavlink.protocol.modes import kind_name, mode_name
from mavlink.state import Level

NO_COMPONENT = -1
"""Number in place of a component id, which is 0 to 255."""

_AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
_SILENT_US = 60_000_000
"""Silence after which another component becomes the autopilot: longer than a radio is out of range, since an impostor
waits for that."""
_ALIVE_US = 3_000_000
"""A component that was received this lately is alive: three heartbeats."""
_NEVER_US = -(1 << 62)
_PATIENCE_US = 3_000_000
"""Time that a second-best source of places has reported before it is used: the best one may report rarely."""
_MAX_SOURCES = 16
"""Sources of places remembered, so that a flood of forged components costs no memory."""


class _Component:
    __slots__ = ("component_id", "heartbeat", "last_us", "reported_us", "sends_heartbeats")

    def __init__(self, component_id: int) -> None:
        self.component_id = component_id
        self.sends_heartbeats = False
        self.heartbeat: Heartbeat | None = None
        self.last_us = self.reported_us = _NEVER_US

    @property
    def rank(self) -> tuple[bool, bool, bool]:
        """The higher, the more it looks like the autopilot."""
        return self.sends_heartbeats, self.component_id == _AUTOPILOT, self.reported_us != _NEVER_US


class Components:
    """The components of one system that send an autopilot's heartbeat, a position or an attitude."""

    def __init__(self) -> None:
        self.autopilot = NO_COMPONENT
        """Id of the one that is the vehicle's autopilot, ``NO_COMPONENT`` before any."""
        self._known: dict[int, _Component] = {}
        self._report = ""

    def report(self) -> tuple[Level, str]:
        """News for the operator since the last call; an empty text for nothing."""
        text, self._report = self._report, ""
        return "warning", text

    @property
    def heartbeat(self) -> Heartbeat | None:
        """The autopilot's newest that was kept, None before any."""
        known = self._known.get(self.autopilot)
        return known.heartbeat if known else None

    @property
    def kind(self) -> str:
        """Type of the vehicle in a word, empty before the first heartbeat."""
        return kind_name(heartbeat.type) if (heartbeat := self.heartbeat) else ""

    @property
    def mode(self) -> str:
        """Flight mode in words, empty before the first heartbeat."""
        if (it := self.heartbeat) is None:
            return ""
        return mode_name(it.type, it.autopilot, it.base_mode, it.custom_mode)

    def add_heartbeat(self, component_id: int, t_us: int) -> bool:
        """Note an autopilot's heartbeat at a Unix time; True when its component is the vehicle's autopilot."""
        component = self._component(component_id)
        component.sends_heartbeats, component.last_us = True, t_us
        return self._is_autopilot(component, t_us)

    def keep_heartbeat(self, sample: Heartbeat) -> None:
        """Keep a heartbeat as the newest of its component."""
        self._component(sample.component_id).heartbeat = sample

    def add_report(self, component_id: int, t_us: int) -> bool:
        """Note a position or an attitude at a Unix time; True when its component is the vehicle's autopilot."""
        component = self._component(component_id)
        component.last_us = component.reported_us = t_us
        return self._is_autopilot(component, t_us)

    def rival(self, t_us: int) -> int:
        """Id of another autopilot that reports while that in use only sends heartbeats; ``NO_COMPONENT`` for none."""
        autopilot = self._known.get(self.autopilot)
        if autopilot is None or t_us - autopilot.last_us > _ALIVE_US or t_us - autopilot.reported_us < _ALIVE_US:
            return NO_COMPONENT
        for other in self._known.values():
            if other is not autopilot and other.sends_heartbeats and t_us - other.reported_us < _ALIVE_US:
                return other.component_id
        return NO_COMPONENT

    def _component(self, component_id: int) -> _Component:
        known = self._known.get(component_id)
        if known is None:
            known = self._known[component_id] = _Component(component_id)
        return known

    def _is_autopilot(self, component: _Component, t_us: int) -> bool:
        """Tell whether a component is the autopilot, which it becomes where it ranks higher or the other is silent."""
        autopilot = self._known.get(self.autopilot)
        if component is autopilot:
            return True
        if (
            autopilot is None
            or component.rank > autopilot.rank
            or (t_us - autopilot.last_us > _SILENT_US and component.rank[0] >= autopilot.rank[0])
        ):
            if autopilot is not None and autopilot.sends_heartbeats:
                self._report = f"component {component.component_id} is the autopilot now, {self.autopilot} was before"
            self.autopilot = component.component_id
            return True
        return False


class PositionSource(NamedTuple):
    """Component and kind of message that report where a vehicle is."""

    own: bool
    """True for the autopilot, False for a companion or a tracker under the same system id."""
    raw: bool
    """GPS_RAW_INT, what a receiver measured; else GLOBAL_POSITION_INT."""
    component_id: int

    @property
    def rank(self) -> tuple[bool, bool]:
        """Order of preference, the highest first."""
        return not self.raw, self.own


class PositionSources:
    """The source of a vehicle's places: the best there ever was.

    An autopilot that has reported a place is never replaced, however long it is silent: who claims its id would only
    have to wait.
    """

    def __init__(self) -> None:
        self.used: PositionSource | None = None
        self._first_us: dict[PositionSource, int] = {}
        self._report = ""

    def report(self) -> tuple[Level, str]:
        """News for the operator since the last call; an empty text for nothing."""
        text, self._report = self._report, ""
        return "info", text

    def add(self, source: PositionSource, t_us: int) -> bool:
        """Note a place that a source reports at a Unix time, µs; True when this source is used."""
        used = self.used
        if source == used:
            return True
        if used is not None and source.rank <= used.rank:
            return False
        if source.rank != (True, True):
            if len(self._first_us) >= _MAX_SOURCES:
                self._first_us.clear()
            if t_us - self._first_us.setdefault(source, t_us) < _PATIENCE_US:
                return False
        self.used = source
        if used is not None or source.rank != (True, True):
            self._report = f"positions are those of {_source_text(source)}"
        return True


def _source_text(source: PositionSource) -> str:
    whose = "its autopilot" if source.own else f"component {source.component_id}"
    if source.raw:
        return f"the GPS receiver of {whose}, since no GLOBAL_POSITION_INT comes"
    return whose if source.own else f"{whose}, since its autopilot reports none"
