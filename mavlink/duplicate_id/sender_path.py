"""One sender's clock and path: the places that it has reported lately, by its own boot time.

Distances are on the sphere, wherever the origin of the local frame is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.estimation.clock import WRAP_US
from mavlink.estimation.interpolation import SampleBuffer
from mavlink.geodesy import wrap_pi
from mavlink.reception.reception import SenderKey

MAX_LINK_LAG_US = 12_000_000
"""A link may be this much later than another without a proof that it carries the same: ten seconds, and some for its
own delays."""
MAX_PROVEN_LAG_US = 60_000_000
"""Longest proven lag where its places lie on the path that is known."""
ALIVE_US = 3_000_000
"""A sender that reported this lately is alive."""

_EARTH_RADIUS_M = 6_371_008.8
"""Mean radius."""
_ESTABLISHED, _ESTABLISHED_US = 3, 500_000
"""Places, and the time that they span, which make a sender one whose silence means something."""
_NOISE_GAIN = 0.2
"""Weight of the newest step in a sender's noise."""
_PATH, _PATH_STEP_US = 130, 500_000
"""Places kept of each sender: one every half second, for a minute."""
_CONFLICT, _AGREEMENT, _ENOUGH = 2, 1, 4
"""Points that a contradiction adds to a sender's score, what an agreement takes off, and the score that is enough: two
contradictions in a row, or more among agreements."""
_SPAN_US = 500_000
"""Time for which contradictions have to last."""
_PAUSE_US = 5_000_000
"""Contradictions farther apart than this do not belong together."""


class ClaimedPlace(NamedTuple):
    """A place that a sender reports."""

    t_us: int
    """Unix µs of arrival."""
    boot_us: int
    """Time by the sender's clock; by arrival for one that has none."""
    lat: float
    lon: float
    up_m: float
    """NaN where heights are not compared."""
    v_east: float
    v_north: float
    std_m: float


class SenderPath:
    """One sender: its clock, its path, and how often it contradicted others lately.

    Args:
        first_us: when it was received first, under whatever run of sequence numbers.
    """

    __slots__ = (
        "_conflict_since_us",
        "_conflict_us",
        "_count",
        "_offset_us",
        "_path",
        "_score",
        "began_us",
        "boot_time_zero",
        "clocked",
        "compared",
        "first_us",
        "follows",
        "late_us",
        "newest",
        "newest_us",
        "noise_m",
        "sender",
    )

    def __init__(self, sender: SenderKey, place: ClaimedPlace, first_us: int) -> None:
        self.sender, self.first_us, self.began_us = sender, first_us, place.t_us
        self._count, self.noise_m = 1, math.inf
        self.compared = False
        """True if another was compared with the newest place: it counts once, however often that other reports."""
        self._score = self._conflict_since_us = self._conflict_us = 0
        self.boot_time_zero = False
        """The newest boot time was 0; twice in a row, the sender has no clock."""
        self._begin(place, clocked=True)

    def _begin(self, place: ClaimedPlace, *, clocked: bool) -> None:
        """Start with its first place, or the first of another clock."""
        self.clocked, self.newest, self.newest_us = clocked, place, place.t_us
        self._offset_us = place.t_us - place.boot_us  # by the message with the least delay
        self.late_us = 0
        """Delay of this sender's link behind another's."""
        self.follows = False
        """True if its places lie on the path of a sender that is ahead of it."""
        self._path: SampleBuffer[ClaimedPlace] = SampleBuffer(_PATH, MAX_PROVEN_LAG_US)
        self._path.add(place.boot_us, place)

    def delay_us(self, place: ClaimedPlace) -> int:
        """Delay, behind the message with the least, with which a place of the same boot clock has come."""
        return _wrapped_us(place.t_us - place.boot_us - self._offset_us)

    def boot_us(self, place: ClaimedPlace) -> int:
        """Boot time of a place of the same clock, unwrapped."""
        return place.t_us - self._offset_us - self.delay_us(place)

    def set_later_than(self, other: SenderPath) -> None:
        """Note that this sender's link is later than another's."""
        behind_us = _wrapped_us(self._offset_us - other._offset_us)
        self.late_us = max(self.late_us, behind_us + other.late_us)

    def made_us(self, place: ClaimedPlace) -> int:
        """Time of one of its places, Unix µs, by its clock and by how late its link is."""
        return self.boot_us(place) + self._offset_us - self.late_us

    def add(self, place: ClaimedPlace, *, clocked: bool, alone: bool) -> None:
        """Add its next place; its noise is measured only where there are others."""
        before, delay_us = self.newest, self.delay_us(place)
        self._count, self.compared = self._count + 1, False
        if clocked != self.clocked or abs(delay_us) > MAX_LINK_LAG_US:
            self._begin(place, clocked=clocked)
            return
        boot_us = place.t_us - self._offset_us - delay_us
        if boot_us != place.boot_us:
            place = place._replace(boot_us=boot_us)  # the clock has wrapped
        if delay_us < 0:
            self._offset_us += delay_us
            self.late_us = max(0, self.late_us + delay_us)
        if not alone and place.t_us - self.newest_us < ALIVE_US:
            step_m = off_course_m(before, place, (place.boot_us - before.boot_us) * 1e-6)
            known = math.isfinite(self.noise_m)
            self.noise_m = self.noise_m + _NOISE_GAIN * (step_m - self.noise_m) if known else step_m
        self.newest_us = place.t_us
        if place.boot_us >= before.boot_us:
            self.newest = place
        last = self._path.newest
        if last is None or abs(place.boot_us - last[0]) >= _PATH_STEP_US:
            self._path.add(place.boot_us, place)

    def around(self, boot_us: int) -> tuple[ClaimedPlace | None, ClaimedPlace | None]:
        """The places before and after a boot time."""
        before, after = self._path.around(boot_us)
        if after is not None or boot_us > self.newest.boot_us:
            return before and before[1], after and after[1]
        return before and before[1], self.newest

    def add_conflict(self, t_us: int) -> bool:
        """Count a contradiction; True when there were enough, over long enough."""
        if not self._score or not 0 <= t_us - self._conflict_us < _PAUSE_US:
            self._score, self._conflict_since_us = 0, t_us
        self._score, self._conflict_us = min(self._score + _CONFLICT, 2 * _ENOUGH), t_us
        return self._score >= _ENOUGH and t_us - self._conflict_since_us >= _SPAN_US

    def add_agreement(self) -> None:
        """Count a place that fits."""
        self._score = max(0, self._score - _AGREEMENT)

    @property
    def established(self) -> bool:
        """True if it has reported for long enough that its silence means something."""
        return self._count >= _ESTABLISHED and self.newest_us - self.first_us >= _ESTABLISHED_US


def same_channel(one: SenderKey, other: SenderKey) -> bool:
    """Tell whether two are one component at one address; their runs of sequence numbers may differ."""
    return (one.link, one.peer, one.component) == (other.link, other.peer, other.component)


def distance_m(one: ClaimedPlace, other: ClaimedPlace) -> float:
    """Distance over the ground."""
    return math.hypot(*_east_north_m(one, other))


def off_course_m(start: ClaimedPlace, end: ClaimedPlace, dt_s: float) -> float:
    """Distance of a place from where the mean velocity of both would have led from the other in this time."""
    east, north = _east_north_m(start, end)
    ve, vn = 0.5 * (start.v_east + end.v_east), 0.5 * (start.v_north + end.v_north)
    if not math.isfinite(ve + vn):
        ve, vn = (end.v_east, end.v_north) if math.isfinite(end.v_east) else (start.v_east, start.v_north)
    if math.isfinite(ve + vn):
        east, north = east - ve * dt_s, north - vn * dt_s
    return math.hypot(east, north)


def _wrapped_us(span_us: int) -> int:
    """A difference of boot times, the short way round."""
    return (span_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2


def _east_north_m(one: ClaimedPlace, other: ClaimedPlace) -> tuple[float, float]:
    """East and north from one place to another: good enough for a few hundred kilometres."""
    north = math.radians(other.lat - one.lat) * _EARTH_RADIUS_M
    east = wrap_pi(math.radians(other.lon - one.lon)) * _EARTH_RADIUS_M * math.cos(math.radians(one.lat))
    return east, north
