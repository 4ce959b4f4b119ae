"""A vehicle's satellite receiver as it describes itself, kept for each way that it is heard over.

What somebody else says of it, over another link or as another component, must not take the fix from positions that come
with one of their own.
"""

from __future__ import annotations

from typing import NamedTuple

from mavlink.protocol.messages import GpsRaw
from mavlink.protocol.modes import fix_name
from mavlink.reception.reception import Speaker
from mavlink.state import Level

__all__ = ["Receiver"]

_FRESH_US = 5_000_000
_STEADY_US = 5_000_000  # a fix that has not changed for so long does not come and go
_MOST = 16

_Way = tuple[int, int, int]


class _Change(NamedTuple):
    t_us: int
    was: str
    fix: str


class Receiver:
    """GPS_RAW_INT of one system."""

    def __init__(self) -> None:
        self._said: dict[_Way, GpsRaw] = {}
        self._change = _Change(0, "", "")
        self._flaps = False

    def take(self, sample: GpsRaw, speaker: Speaker) -> tuple[Level, str]:
        """Keeps what a receiver says of itself; what to tell of it, an empty text for nothing.

        A fix that comes and goes is told once, and once more when it is steady again.
        """
        way, last, fix = _way(speaker), self._change, fix_name(sample.fix_type)
        before = self._said.pop(way, None)
        if len(self._said) >= _MOST:
            del self._said[next(iter(self._said))]
        self._said[way] = sample
        lately = 0 <= sample.t_us - last.t_us < _STEADY_US
        was = fix_name(before.fix_type) if before is not None else fix
        if was == fix:
            if not self._flaps or lately:
                return "info", ""
            self._flaps = False
            return "info", f"GPS fix {fix}, steady again"
        self._change = _Change(sample.t_us, was, fix)
        if lately and (self._flaps or (was, fix) == last[1:]):
            return "info", ""  # or the same over another link
        self._flaps = lately and fix == last.was
        if self._flaps:
            return "warning", f"GPS fix comes and goes: {last.was}, {last.fix}"
        worse = before is not None and sample.fix_type < min(before.fix_type, 3)
        return "warning" if worse else "info", f"GPS fix {fix}, was {was}"

    def fresh(self, t_us: int, speaker: Speaker) -> GpsRaw | None:
        """What it said in the last seconds over the way of a speaker; where it says nothing there, over another."""
        own = self._said.get(_way(speaker))
        if own is not None and t_us - own.t_us < _FRESH_US:
            return own
        return self.newest(t_us, speaker.component)

    def newest(self, t_us: int, component_id: int) -> GpsRaw | None:
        """What it said last as one component in the last seconds."""
        for way in reversed(self._said):
            if way[2] == component_id:
                said = self._said[way]
                return said if t_us - said.t_us < _FRESH_US else None
        return None


def _way(speaker: Speaker) -> _Way:
    return speaker.link, speaker.peer, speaker.component
