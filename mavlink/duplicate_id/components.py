"""Which component of a system speaks for the vehicle: its autopilot.

Companions, gimbals and payload computers share the autopilot's system id and may beat and tell places too. The
autopilot beats as one, and by the standard its component id is 1. None of this proves anything: where two components
contradict each other, neither is believed (:mod:`mavlink.duplicate_id.id_conflict`).
"""

from __future__ import annotations

from mavlink.protocol.messages import Heartbeat
from mavlink.state import Level

__all__ = ["NOBODY", "Components"]

NOBODY = -1  # component ids are 0 to 255

_AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
_SILENT_US = 60_000_000
"""Another component takes over after this: longer than a radio is out of range, since an impostor waits for that."""
_ALIVE_US = 3_000_000
_NEVER_US = -(1 << 62)


class _Component:
    __slots__ = ("beats", "component_id", "heard_us", "heartbeat", "reported_us")

    def __init__(self, component_id: int) -> None:
        self.component_id = component_id
        self.beats = False
        self.heartbeat: Heartbeat | None = None
        self.heard_us = self.reported_us = _NEVER_US

    @property
    def standing(self) -> tuple[bool, bool, bool]:
        return self.beats, self.component_id == _AUTOPILOT, self.reported_us != _NEVER_US


class Components:
    """The components of one system that beat as an autopilot, or tell a place or an attitude."""

    def __init__(self) -> None:
        self.speaking = NOBODY
        """Id of the one that speaks for the vehicle, ``NOBODY`` before any."""
        self._known: dict[int, _Component] = {}
        self._news = ""

    def news(self) -> tuple[Level, str]:
        """What to tell since the last call; an empty text for nothing."""
        text, self._news = self._news, ""
        return "warning", text

    @property
    def heartbeat(self) -> Heartbeat | None:
        """The vehicle's newest that was kept, None before any."""
        known = self._known.get(self.speaking)
        return known.heartbeat if known else None

    def beats(self, component_id: int, t_us: int) -> bool:
        """Hears an autopilot's heartbeat at a Unix time; True when its component speaks for the vehicle."""
        component = self._component(component_id)
        component.beats, component.heard_us = True, t_us
        return self._speaks(component, t_us)

    def keep(self, sample: Heartbeat) -> None:
        """Keeps a heartbeat as the newest of its component."""
        self._component(sample.component_id).heartbeat = sample

    def reports(self, component_id: int, t_us: int) -> bool:
        """Hears a place or an attitude of a component at a Unix time; True when it is the vehicle's."""
        component = self._component(component_id)
        component.heard_us = component.reported_us = t_us
        return self._speaks(component, t_us)

    def rival(self, t_us: int) -> int:
        """Id of another autopilot that reports while the one that speaks only beats; ``NOBODY`` for none."""
        speaking = self._known.get(self.speaking)
        if speaking is None or t_us - speaking.heard_us > _ALIVE_US or t_us - speaking.reported_us < _ALIVE_US:
            return NOBODY
        for other in self._known.values():
            if other is not speaking and other.beats and t_us - other.reported_us < _ALIVE_US:
                return other.component_id
        return NOBODY

    def _component(self, component_id: int) -> _Component:
        known = self._known.get(component_id)
        if known is None:
            known = self._known[component_id] = _Component(component_id)
        return known

    def _speaks(self, component: _Component, t_us: int) -> bool:
        speaking = self._known.get(self.speaking)
        if component is speaking:
            return True
        if (
            speaking is None
            or component.standing > speaking.standing
            or (t_us - speaking.heard_us > _SILENT_US and component.standing[0] >= speaking.standing[0])
        ):
            if speaking is not None and speaking.beats:
                self._news = (
                    f"component {component.component_id} speaks for the vehicle now, {self.speaking} did before"
                )
            self.speaking = component.component_id
            return True
        return False
