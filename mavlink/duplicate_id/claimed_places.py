"""Places that each sender of one system id reports, and whether all of it can be true of one vehicle.

Senders are distinguished by component, address and run of sequence numbers, and each has a clock of its own until its
places prove otherwise. Two radios of one autopilot share a boot clock: what one brings seconds late lies on the path
that the other has reported, at the same boot time. Two components of one vehicle need not share a clock, and are at the
same place. Where neither holds, one of them is not of this vehicle, whatever its clock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.duplicate_id.sender_path import (
    ALIVE_US,
    MAX_LINK_LAG_US,
    MAX_PROVEN_LAG_US,
    ClaimedPlace,
    SenderPath,
    distance_m,
    off_course_m,
    same_channel,
)
from mavlink.estimation.positions import VehicleLimits, climbs_too_fast, too_far
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import GlobalPosition
from mavlink.reception.reception import SenderKey

FRESH_BOOT_US = 15_000_000
"""A clock that counts less may be this vehicle's after a reboot, while a late link still brings the count before."""
_LATE_US = 1_000_000
"""A place that is later than this is one of the past."""
_MAX_SENDERS = 8
"""Senders compared; a flood of addresses must cost neither memory nor time."""
_REMEMBERED_US = 60_000_000
"""Time for which the last place of a silent sender counts."""
_MARGIN_M, _NOISE_FACTOR = 3.0, 4.0
"""Allowed difference of places of one autopilot: this, and this many times the noise of the better one."""
_RECEIVERS_M, _RECEIVER_STDS = 10.0, 3.0
"""Allowed difference of two receivers of one vehicle: this, or this many σ."""
_COMPONENT_LAG_S = 1.0
"""A payload computer may report where the vehicle was this long ago."""
_BESIDE_US = 1_500_000
"""Places this close in time decide; farther apart they only rule out."""


class PlaceConflict(NamedTuple):
    """Another sender whose places and this one's cannot be of one vehicle."""

    other: SenderKey
    gap_m: float


class ClaimedPlaces:
    """The places of all senders of one system id.

    Args:
        drives: a ground vehicle, whose height is not compared.
    """

    def __init__(self, limits: VehicleLimits, *, drives: bool) -> None:
        self._limits, self._drives = limits, drives
        self._paths: dict[SenderKey, SenderPath] = {}
        self._faster: SenderKey | None = None

    def add(self, sender: SenderKey, sample: GlobalPosition, std_m: float) -> PlaceConflict | None:
        """Keep a place and compare it with those of other senders.

        Args:
            sample: a place that may be one, see :func:`mavlink.estimation.positions.place_error`.
            std_m: 1σ.

        Returns:
            The sender that it contradicts, once that is certain.
        """
        path = self._paths.get(sender)
        clocked = sample.boot_ms > 0 or path is None or not path.boot_time_zero
        known = math.hypot(sample.v_east, sample.v_north) <= self._limits.max_speed
        place = ClaimedPlace(
            sample.t_us,
            sample.boot_ms * 1000 if clocked else sample.t_us,
            sample.lat_deg,
            sample.lon_deg,
            math.nan if self._drives else sample.alt_m,
            sample.v_east if known else math.nan,
            sample.v_north if known else math.nan,
            std_m,
        )
        if path is None:
            path = self._begin(sender, place)
        else:
            path.add(place, clocked=clocked, alone=len(self._paths) == 1)
        path.boot_time_zero = sample.boot_ms == 0
        return self._compare_with_others(path, place) if len(self._paths) > 1 else None

    def _compare_with_others(self, path: SenderPath, place: ClaimedPlace) -> PlaceConflict | None:
        found = None
        for other in self._paths.values():
            if other is not path:
                gap_m = self._compare(other, path, place)
                if gap_m > 0.0:
                    # both count, so that neither many addresses nor many that agree hide one that does not
                    certain = [side.add_conflict(place.t_us) for side in (other, path)]
                    if any(certain) and (found is None or gap_m > found.gap_m):
                        found = PlaceConflict(other.sender, gap_m)
                elif gap_m == 0.0:
                    other.add_agreement()
                    path.add_agreement()
        return found

    def is_faster_link(self, sender: SenderKey) -> bool:
        """Tell whether a sender was found to be the same vehicle over a faster link."""
        return self._faster is not None and same_channel(sender, self._faster)

    def is_slower_link(self, sender: SenderKey) -> bool:
        """Tell whether a sender was found to be the same vehicle over a link a second or more later than another."""
        path = self._paths.get(sender)
        if path is not None:
            return path.late_us > 0
        return any(path.late_us > 0 for path in self._paths.values() if same_channel(path.sender, sender))

    def is_reporting(self, sender: SenderKey, t_us: int) -> bool:
        """Tell whether places came from a sender in the last seconds."""
        return any(t_us - p.newest_us < ALIVE_US and same_channel(p.sender, sender) for p in self._paths.values())

    def is_only_one(self, sender: SenderKey, t_us: int) -> bool:
        """Tell whether places came from this sender alone in the last seconds."""
        lately = [path.sender for path in self._paths.values() if t_us - path.newest_us < ALIVE_US]
        return bool(lately) and all(same_channel(other, sender) for other in lately)

    def _begin(self, sender: SenderKey, place: ClaimedPlace) -> SenderPath:
        paths = self._paths
        # after a loss the run of sequence numbers is another, and the sender the same
        before = [path for path in paths.values() if same_channel(path.sender, sender)]
        if len(paths) >= _MAX_SENDERS:
            del paths[min(paths, key=lambda key: (paths[key].established, paths[key].newest_us))]
        first_us = min((path.first_us for path in before), default=place.t_us)
        new = paths[sender] = SenderPath(sender, place, first_us)
        new.late_us = max((path.late_us for path in before if abs(path.delay_us(place)) < _LATE_US), default=0)
        return new

    def _compare(self, x: SenderPath, y: SenderPath, place: ClaimedPlace) -> float:
        """Distance of y's newest place from all that x allows, metres: 0 where both can be true, NaN unknown."""
        same_component = x.sender.component == y.sender.component
        margin_m = self._margin_m(x, y, place, same_component)
        on_path_m = self._gap_on_path(x, y, place, margin_m)
        if place.t_us - x.newest_us >= ALIVE_US:
            late = same_component and on_path_m == 0.0  # what a link still brings of one that has fallen silent
            return 0.0 if late else self._gap_after_silence(x, y, place)
        if x.newest_us < y.began_us and same_channel(x.sender, y.sender):
            return math.nan  # one sender, whose sequence numbers jumped when many were lost
        by_clock_m = self._gap_by_clock(x, y, place, margin_m) if on_path_m is None else on_path_m
        rebooted = min(x.newest.boot_us, y.newest.boot_us) < FRESH_BOOT_US
        if by_clock_m == 0.0 or (same_component and not rebooted and on_path_m is not None):
            return by_clock_m or 0.0
        gap_m = by_clock_m
        if gap_m is None or not same_component or rebooted:
            by_arrival_m = self._gap_by_arrival(x, y, place, margin_m)
            uncertain = gap_m is not None and math.isnan(gap_m)
            gap_m = math.nan if uncertain and by_arrival_m else by_arrival_m
        if gap_m > 0.0:
            if x.compared:
                return math.nan
            x.compared = True
        return gap_m

    def _delay_us(self, x: SenderPath, y: SenderPath, place: ClaimedPlace) -> int | None:
        """Delay of y's place behind x's fastest, if both have one clock; None where they cannot."""
        delay_us = x.delay_us(place)
        return delay_us if x.clocked and y.clocked and -MAX_LINK_LAG_US <= delay_us <= MAX_PROVEN_LAG_US else None

    def _gap_on_path(self, x: SenderPath, y: SenderPath, place: ClaimedPlace, margin_m: float) -> float | None:
        """The gap if both have one clock and x has reported before and after that time; None where it has not."""
        delay_us = self._delay_us(x, y, place)
        if delay_us is None:
            return None
        boot_us = x.boot_us(place)
        before, after = x.around(boot_us)
        if before is None or after is None:
            return None
        gap_m = self._off_path_m(before, after, place, boot_us)
        if gap_m > margin_m:
            return gap_m if delay_us <= MAX_LINK_LAG_US else None
        if delay_us > _LATE_US:
            y.set_later_than(x)
            y.follows, self._faster = True, x.sender
        return 0.0

    def _gap_by_clock(self, x: SenderPath, y: SenderPath, place: ClaimedPlace, margin_m: float) -> float | None:
        """The gap if both have one clock and x has reported only before that time, or only after it."""
        delay_us = self._delay_us(x, y, place)
        if delay_us is None or delay_us > MAX_LINK_LAG_US:
            return None
        boot_us = x.boot_us(place)
        before, after = x.around(boot_us)
        end = before or after or x.newest
        gap_m = self._gap_from(end, place, (boot_us - end.boot_us) * 1e-6, margin_m)
        if gap_m > 0.0:
            # a jump of the receiver is on its way over the later link, whose places will show it
            return math.nan if abs(delay_us) > _LATE_US and (x.follows or y.follows) else gap_m
        if delay_us > _LATE_US and before is None:
            y.set_later_than(x)  # made before x was received: it may be, and soon x's path will show it
        return gap_m

    def _gap_by_arrival(self, x: SenderPath, y: SenderPath, place: ClaimedPlace, margin_m: float) -> float:
        """The gap if each has a clock of its own: between where both report the vehicle to be now."""
        dt_us = y.made_us(place) - x.made_us(x.newest)
        return math.nan if abs(dt_us) > ALIVE_US else self._gap_from(x.newest, place, dt_us * 1e-6, margin_m)

    def _gap_from(self, start: ClaimedPlace, place: ClaimedPlace, dt_s: float, margin_m: float) -> float:
        beside_m = off_course_m(start, place, dt_s)
        # with the mean of both velocities s = v t ± ¼ a t², with one of them v t ± ½ a t²
        both = math.isfinite(start.v_east + place.v_east)
        allowed_m = margin_m + (0.25 if both else 0.5) * self._limits.max_acceleration * dt_s * dt_s
        gap_m = distance_m(start, place)
        if beside_m > allowed_m or self._is_unreachable(start, place, gap_m, abs(dt_s)):
            return max(gap_m, beside_m)
        return 0.0 if abs(dt_s) * 1e6 <= _BESIDE_US else math.nan

    def _off_path_m(self, before: ClaimedPlace, after: ClaimedPlace, place: ClaimedPlace, boot_us: int) -> float:
        """Distance of a place from the way between two others, less what the vehicle may have done between them."""
        span_s = (after.boot_us - before.boot_us) * 1e-6
        if span_s <= 0.0:
            return distance_m(before, place)
        part = (boot_us - before.boot_us) * 1e-6 / span_s
        middle = before._replace(
            lat=before.lat + part * (after.lat - before.lat),
            lon=before.lon + part * math.degrees(wrap_pi(math.radians(after.lon - before.lon))),
        )
        # a chord leaves a curve by ⅛ a t²; a jump of the receiver was somewhere in between
        allowed_m = 0.125 * self._limits.max_acceleration * span_s * span_s + off_course_m(before, after, span_s)
        return max(0.0, distance_m(middle, place) - allowed_m)

    def _gap_after_silence(self, x: SenderPath, y: SenderPath, place: ClaimedPlace) -> float:
        """The gap where y, received only since x is silent and over another channel, is where x cannot have got to."""
        silent_us = place.t_us - x.newest_us
        began_before = y.first_us <= x.newest_us
        if began_before or not x.established or silent_us > _REMEMBERED_US or same_channel(x.sender, y.sender):
            return math.nan
        gap_m = distance_m(x.newest, place)
        return gap_m if self._is_unreachable(x.newest, place, gap_m, silent_us * 1e-6) else math.nan

    def _is_unreachable(self, start: ClaimedPlace, place: ClaimedPlace, gap_m: float, dt_s: float) -> bool:
        return too_far(gap_m, dt_s, max(start.std_m, place.std_m), self._limits) or climbs_too_fast(
            place.up_m - start.up_m, dt_s, self._limits
        )

    def _margin_m(self, x: SenderPath, y: SenderPath, place: ClaimedPlace, same_component: bool) -> float:
        """Largest difference of two places of one vehicle."""
        least_m = min(x.noise_m, y.noise_m)
        noise_m = _NOISE_FACTOR * least_m if math.isfinite(least_m) else 0.0
        if same_component:
            return _MARGIN_M + noise_m
        stds_m = _RECEIVER_STDS * math.hypot(x.newest.std_m, place.std_m)
        speed = math.hypot(place.v_east, place.v_north)
        return max(_RECEIVERS_M, stds_m) + noise_m + (_COMPONENT_LAG_S * speed if math.isfinite(speed) else 0.0)
