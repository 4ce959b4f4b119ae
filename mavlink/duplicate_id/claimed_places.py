"""Where each sender of one system id says that the vehicle is, and whether all of it can be true of one vehicle.

Senders are told apart by component, address and count of packets, and each has a clock of its own until its places
prove otherwise. Two radios of one autopilot share a boot clock: what one brings seconds late lies on the path that the
other has told, at the same boot time. Two components of one vehicle need not share a clock, and are at the same place.
Where neither holds, one of them is not of this vehicle, whatever its clock says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mavlink.estimation.position_validation import GateParams, climbs_too_fast, too_far
from mavlink.estimation.sample_buffer import History
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import GlobalPosition
from mavlink.reception.reception import Speaker

__all__ = ["FRESH_US", "LATE_MOST_US", "Dissent", "Places", "same_way"]

LATE_MOST_US = 12_000_000
"""A link may be this much later than another without a proof that it carries the same: ten seconds, and some for its
own delays."""
FRESH_US = 15_000_000
"""A clock that counts less may be this vehicle's after a reboot, while a link still brings what was said before."""
_LATE_PROVEN_US = 60_000_000  # and this much where the places that it tells lie on the path that is known
_LATE_US = 1_000_000  # what is later than this is not of this moment
_WRAP_US = (1 << 32) * 1000
_EARTH_M = 6_371_008.8
_MOST = 8  # senders compared; a flood of addresses must cost neither memory nor time
_ALIVE_US = 3_000_000
_REMEMBERED_US = 60_000_000  # where a silent sender was last counts for so long
_PROVEN, _PROVEN_US = 3, 500_000  # places on end that make a sender one whose silence means something
_PLACE_M, _NOISE_FACTOR, _NOISE_MEMORY = 3.0, 4.0, 0.2
_RECEIVER_M, _RECEIVER_STDS = 10.0, 3.0  # by which two receivers of one vehicle may differ
_COMPONENT_S = 1.0  # a payload computer hands on where the vehicle was a moment ago
_PATH, _PATH_US = 130, 500_000  # places kept of each sender: one every half second, for a minute
_BESIDE_US = 1_500_000  # places so close in time decide; farther apart they only rule out
_DISSENT, _CONSENT, _ENOUGH = 2, 1, 4
_SPAN_US = 500_000
_PAUSE_US = 5_000_000


class Dissent(NamedTuple):
    """Another sender, where this one's words cannot be true of the same vehicle."""

    other: Speaker
    gap_m: float


class _Place(NamedTuple):
    t_us: int
    """Unix µs of arrival."""
    boot_us: int
    """By the sender's clock; by arrival for one that has none."""
    lat: float
    lon: float
    up_m: float
    """NaN where heights are not compared."""
    v_east: float
    v_north: float
    std_m: float


class _Track:
    """One sender: its clock, its path, and how often it contradicted others lately."""

    __slots__ = (
        "began_us",
        "clocked",
        "compared",
        "count",
        "dissent_us",
        "first_us",
        "follows",
        "last_us",
        "late_us",
        "newest",
        "noise_m",
        "offset_us",
        "path",
        "score",
        "since_us",
        "speaker",
        "zero",
    )

    def __init__(self, speaker: Speaker, place: _Place, first_us: int) -> None:
        self.speaker, self.first_us, self.began_us = speaker, first_us, place.t_us
        self.count, self.noise_m = 1, math.inf
        self.compared = False
        """Whether another was judged by the newest place: it counts once, however often that other speaks."""
        self.score = self.since_us = self.dissent_us = 0
        self.zero = False
        self.begin(place, clocked=True)

    def begin(self, place: _Place, *, clocked: bool) -> None:
        """Its first place, or the first of another clock."""
        self.clocked, self.newest, self.last_us = clocked, place, place.t_us
        self.offset_us = place.t_us - place.boot_us  # by its quickest message
        self.late_us = 0  # by which it was found to be later than another
        self.follows = False  # and its places lay on the path of that one
        self.path: History[_Place] = History(_PATH, _LATE_PROVEN_US)
        self.path.add(place.boot_us, place)

    def delay_us(self, place: _Place) -> int:
        """How much later than by this sender's quickest message a place of the same boot clock has come."""
        return (place.t_us - place.boot_us - self.offset_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2

    def boot_us(self, place: _Place) -> int:
        """Boot time of a place of the same clock, unwrapped."""
        return place.t_us - self.offset_us - self.delay_us(place)

    def trails(self, other: _Track) -> None:
        """Is found to be later than another."""
        behind_us = (self.offset_us - other.offset_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
        self.late_us = max(self.late_us, behind_us + other.late_us)

    def made_us(self, place: _Place) -> int:
        """When one of its places was made, Unix µs by its quickest message and by how late that was."""
        return self.boot_us(place) + self.offset_us - self.late_us

    def add(self, place: _Place, *, clocked: bool, alone: bool) -> None:
        """Its next place; how noisy it is matters only to others."""
        before, delay_us = self.newest, self.delay_us(place)
        self.count, self.compared = self.count + 1, False
        if clocked != self.clocked or abs(delay_us) > LATE_MOST_US:
            self.begin(place, clocked=clocked)
            return
        boot_us = place.t_us - self.offset_us - delay_us
        if boot_us != place.boot_us:
            place = place._replace(boot_us=boot_us)  # the clock has wrapped
        if delay_us < 0:
            self.offset_us += delay_us
            self.late_us = max(0, self.late_us + delay_us)
        if not alone and place.t_us - self.last_us < _ALIVE_US:
            step_m = _beside_m(before, place, (place.boot_us - before.boot_us) * 1e-6)
            known = math.isfinite(self.noise_m)
            self.noise_m = self.noise_m + _NOISE_MEMORY * (step_m - self.noise_m) if known else step_m
        self.last_us = place.t_us
        if place.boot_us >= before.boot_us:
            self.newest = place
        last = self.path.last
        if last is None or abs(place.boot_us - last[0]) >= _PATH_US:
            self.path.add(place.boot_us, place)

    def around(self, boot_us: int) -> tuple[_Place | None, _Place | None]:
        """The places before and after a boot time."""
        before, after = self.path.around(boot_us)
        if after is not None or boot_us > self.newest.boot_us:
            return before and before[1], after and after[1]
        return before and before[1], self.newest

    def dissent(self, t_us: int) -> bool:
        """Counts a contradiction; True when there were enough, over long enough."""
        if not self.score or not 0 <= t_us - self.dissent_us < _PAUSE_US:
            self.score, self.since_us = 0, t_us
        self.score, self.dissent_us = min(self.score + _DISSENT, 2 * _ENOUGH), t_us
        return self.score >= _ENOUGH and t_us - self.since_us >= _SPAN_US

    def consent(self) -> None:
        """Counts a place that fits."""
        self.score = max(0, self.score - _CONSENT)

    @property
    def proven(self) -> bool:
        """Whether it has spoken for long enough to be somebody."""
        return self.count >= _PROVEN and self.last_us - self.first_us >= _PROVEN_US


class Places:
    """The places of all senders of one system id.

    Args:
        params: what the vehicle can do.
        drives: a ground vehicle, whose height says nothing.
    """

    def __init__(self, params: GateParams, *, drives: bool) -> None:
        self._params, self._drives = params, drives
        self._tracks: dict[Speaker, _Track] = {}
        self._quicker: Speaker | None = None

    def take(self, speaker: Speaker, sample: GlobalPosition, std_m: float) -> Dissent | None:
        """Keeps a place and compares it with those of others.

        Args:
            speaker: who says it.
            sample: a place that may be one, see :func:`mavlink.estimation.position_validation.nonsense`.
            std_m: 1σ.

        Returns:
            Whom it contradicts, once that is certain.
        """
        track = self._tracks.get(speaker)
        clocked = sample.boot_ms > 0 or track is None or not track.zero
        known = math.hypot(sample.v_east, sample.v_north) <= self._params.max_speed
        place = _Place(
            sample.t_us,
            sample.boot_ms * 1000 if clocked else sample.t_us,
            sample.lat_deg,
            sample.lon_deg,
            math.nan if self._drives else sample.alt_m,
            sample.v_east if known else math.nan,
            sample.v_north if known else math.nan,
            std_m,
        )
        if track is None:
            track = self._begin(speaker, place)
        else:
            track.add(place, clocked=clocked, alone=len(self._tracks) == 1)
        track.zero = sample.boot_ms == 0  # twice on end: it has no clock
        if len(self._tracks) == 1:
            return None
        found = None
        for other in self._tracks.values():
            if other is not track:
                gap_m = self._compare(other, track, place)
                if gap_m > 0.0:
                    # both count, so that neither many addresses nor many who agree hide one who does not
                    certain = [side.dissent(place.t_us) for side in (other, track)]
                    if any(certain) and (found is None or gap_m > found.gap_m):
                        found = Dissent(other.speaker, gap_m)
                elif gap_m == 0.0:
                    other.consent()
                    track.consent()
        return found

    def quicker(self, speaker: Speaker) -> bool:
        """Whether a sender was found to be the same vehicle over a quicker link."""
        return self._quicker is not None and same_way(speaker, self._quicker)

    def trails(self, speaker: Speaker) -> bool:
        """Whether a sender was found to be the same vehicle over a link that is a second or more later than another."""
        track = self._tracks.get(speaker)
        if track is not None:
            return track.late_us > 0
        return any(track.late_us > 0 for track in self._tracks.values() if same_way(track.speaker, speaker))

    def tells(self, speaker: Speaker, t_us: int) -> bool:
        """Whether places came from a sender in the last seconds."""
        return any(t_us - t.last_us < _ALIVE_US and same_way(t.speaker, speaker) for t in self._tracks.values())

    def alone(self, speaker: Speaker, t_us: int) -> bool:
        """Whether they came from that one only."""
        lately = [t.speaker for t in self._tracks.values() if t_us - t.last_us < _ALIVE_US]
        return bool(lately) and all(same_way(other, speaker) for other in lately)

    def _begin(self, speaker: Speaker, place: _Place) -> _Track:
        tracks = self._tracks
        # after a loss the count of packets is another, and the sender the same
        before = [track for track in tracks.values() if same_way(track.speaker, speaker)]
        if len(tracks) >= _MOST:
            del tracks[min(tracks, key=lambda key: (tracks[key].proven, tracks[key].last_us))]
        new = tracks[speaker] = _Track(speaker, place, min((track.first_us for track in before), default=place.t_us))
        new.late_us = max((track.late_us for track in before if abs(track.delay_us(place)) < _LATE_US), default=0)
        return new

    def _compare(self, x: _Track, y: _Track, place: _Place) -> float:
        """How far y's newest place is from all that x allows, metres: 0 where both can be true, NaN not known."""
        alike = x.speaker.component == y.speaker.component
        margin_m = self._margin_m(x, y, place, alike)
        on_path_m = self._on_path(x, y, place, margin_m)
        if place.t_us - x.last_us >= _ALIVE_US:
            late = alike and on_path_m == 0.0  # what a link still brings of one that has fallen silent
            return 0.0 if late else self._after_silence(x, y, place)
        if x.last_us < y.began_us and same_way(x.speaker, y.speaker):
            return math.nan  # one sender, whose count of packets leapt when many were lost
        by_clock_m = self._by_clock(x, y, place, margin_m) if on_path_m is None else on_path_m
        rebooted = min(x.newest.boot_us, y.newest.boot_us) < FRESH_US
        if by_clock_m == 0.0 or (alike and not rebooted and on_path_m is not None):
            return by_clock_m or 0.0
        gap_m = by_clock_m
        if gap_m is None or not alike or rebooted:
            by_arrival_m = self._by_arrival(x, y, place, margin_m)
            doubtful = gap_m is not None and math.isnan(gap_m)
            gap_m = math.nan if doubtful and by_arrival_m else by_arrival_m
        if gap_m > 0.0:
            if x.compared:
                return math.nan
            x.compared = True
        return gap_m

    def _delay_us(self, x: _Track, y: _Track, place: _Place) -> int | None:
        """By how much y's place is later than x's quickest, if both have one clock; None where they cannot."""
        delay_us = x.delay_us(place)
        return delay_us if x.clocked and y.clocked and -LATE_MOST_US <= delay_us <= _LATE_PROVEN_US else None

    def _on_path(self, x: _Track, y: _Track, place: _Place, margin_m: float) -> float | None:
        """As if both had one clock, where x has told where the vehicle was before and after; None where it has not."""
        delay_us = self._delay_us(x, y, place)
        if delay_us is None:
            return None
        boot_us = x.boot_us(place)
        before, after = x.around(boot_us)
        if before is None or after is None:
            return None
        gap_m = self._off_path_m(before, after, place, boot_us)
        if gap_m > margin_m:
            return gap_m if delay_us <= LATE_MOST_US else None
        if delay_us > _LATE_US:
            y.trails(x)
            y.follows, self._quicker = True, x.speaker
        return 0.0

    def _by_clock(self, x: _Track, y: _Track, place: _Place, margin_m: float) -> float | None:
        """As if both had one clock, where x has told only where the vehicle was before, or after."""
        delay_us = self._delay_us(x, y, place)
        if delay_us is None or delay_us > LATE_MOST_US:
            return None
        boot_us = x.boot_us(place)
        before, after = x.around(boot_us)
        end = before or after or x.newest
        gap_m = self._from_place(end, place, (boot_us - end.boot_us) * 1e-6, margin_m)
        if gap_m > 0.0:
            # a jump of the receiver is on its way over the later link, whose places will tell
            return math.nan if abs(delay_us) > _LATE_US and (x.follows or y.follows) else gap_m
        if delay_us > _LATE_US and before is None:
            y.trails(x)  # made before x was heard: it may be, and soon x's path will tell
        return gap_m

    def _by_arrival(self, x: _Track, y: _Track, place: _Place, margin_m: float) -> float:
        """As if each had a clock of its own: where both say that the vehicle is now."""
        dt_us = y.made_us(place) - x.made_us(x.newest)
        return math.nan if abs(dt_us) > _ALIVE_US else self._from_place(x.newest, place, dt_us * 1e-6, margin_m)

    def _from_place(self, start: _Place, place: _Place, dt_s: float, margin_m: float) -> float:
        beside_m = _beside_m(start, place, dt_s)
        # with the mean of both velocities s = v t ± ¼ a t², with one of them v t ± ½ a t²
        both = math.isfinite(start.v_east + place.v_east)
        may_m = margin_m + (0.25 if both else 0.5) * self._params.max_acceleration * dt_s * dt_s
        gap_m = _gap_m(start, place)
        if beside_m > may_m or self._unreachable(start, place, gap_m, abs(dt_s)):
            return max(gap_m, beside_m)
        return 0.0 if abs(dt_s) * 1e6 <= _BESIDE_US else math.nan

    def _off_path_m(self, before: _Place, after: _Place, place: _Place, boot_us: int) -> float:
        """How far a place is from between two others, less what the vehicle may have done between them."""
        span_s = (after.boot_us - before.boot_us) * 1e-6
        if span_s <= 0.0:
            return _gap_m(before, place)
        part = (boot_us - before.boot_us) * 1e-6 / span_s
        middle = before._replace(
            lat=before.lat + part * (after.lat - before.lat),
            lon=before.lon + part * math.degrees(wrap_pi(math.radians(after.lon - before.lon))),
        )
        # a chord leaves a curve by ⅛ a t²; a jump of the receiver was somewhere in between
        may_m = 0.125 * self._params.max_acceleration * span_s * span_s + _beside_m(before, after, span_s)
        return max(0.0, _gap_m(middle, place) - may_m)

    def _after_silence(self, x: _Track, y: _Track, place: _Place) -> float:
        """Whether y, heard only since x is silent and another way, is where x cannot have got to meanwhile."""
        silent_us = place.t_us - x.last_us
        if y.first_us <= x.last_us or not x.proven or silent_us > _REMEMBERED_US or same_way(x.speaker, y.speaker):
            return math.nan
        gap_m = _gap_m(x.newest, place)
        return gap_m if self._unreachable(x.newest, place, gap_m, silent_us * 1e-6) else math.nan

    def _unreachable(self, start: _Place, place: _Place, gap_m: float, dt_s: float) -> bool:
        return too_far(gap_m, dt_s, max(start.std_m, place.std_m), self._params) or climbs_too_fast(
            place.up_m - start.up_m, dt_s, self._params
        )

    def _margin_m(self, x: _Track, y: _Track, place: _Place, alike: bool) -> float:
        """By how much two may differ who tell of one vehicle."""
        least_m = min(x.noise_m, y.noise_m)
        noise_m = _NOISE_FACTOR * least_m if math.isfinite(least_m) else 0.0
        if alike:
            return _PLACE_M + noise_m
        stds_m = _RECEIVER_STDS * math.hypot(x.newest.std_m, place.std_m)
        speed = math.hypot(place.v_east, place.v_north)
        return max(_RECEIVER_M, stds_m) + noise_m + (_COMPONENT_S * speed if math.isfinite(speed) else 0.0)


def same_way(one: Speaker, other: Speaker) -> bool:
    """Whether two are one component at one address; their counts of packets may differ."""
    return (one.link, one.peer, one.component) == (other.link, other.peer, other.component)


def _gap_m(one: _Place, other: _Place) -> float:
    east, north = _step(one, other)
    return math.hypot(east, north)


def _beside_m(start: _Place, place: _Place, dt_s: float) -> float:
    """Distance from where the mean of both velocities would have led."""
    east, north = _step(start, place)
    ve, vn = 0.5 * (start.v_east + place.v_east), 0.5 * (start.v_north + place.v_north)
    if not math.isfinite(ve + vn):
        ve, vn = (place.v_east, place.v_north) if math.isfinite(place.v_east) else (start.v_east, start.v_north)
    if math.isfinite(ve + vn):
        east, north = east - ve * dt_s, north - vn * dt_s
    return math.hypot(east, north)


def _step(one: _Place, other: _Place) -> tuple[float, float]:
    """East and north, metres on the sphere: good enough for a few hundred kilometres and wherever the origin is."""
    north = math.radians(other.lat - one.lat) * _EARTH_M
    east = wrap_pi(math.radians(other.lon - one.lon)) * _EARTH_M * math.cos(math.radians(one.lat))
    return east, north
