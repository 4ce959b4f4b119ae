"""A vehicle's clock on Unix time, learnt from when its messages arrive.

With b the vehicle's boot time of a message and a its arrival, a − b = offset + drift · b + delay, delay ≥ 0: the offset
and the drift are those of the line that lies under all points as closely as it can (Moon, Skelly, Towsley, INFOCOM
1999, doi:10.1109/INFCOM.1999.749287: the edge of the lower convex hull over their mean). The least delay of the link
itself cannot be seen this way and stays in the offset. The vehicle's own Unix time is never used: it is often off by
a second.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

__all__ = ["ClockParams", "VehicleClock"]

_WRAP_US = (1 << 32) * 1000
_MS = 1000
_S = 1_000_000
_LINES, _LINE_US = 4, 5 * _S


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockParams:
    """How a vehicle's clock may behave."""

    max_drift: float = 500e-6
    """Greatest drift believed of a fit that may be a link's doing. Crystals are within some tens of ppm, autopilots
    measure 120–150 ppm. Raise for worse crystals, lower for steadier fits."""
    max_sure_drift: float = 0.05
    """Greatest drift followed once it is sure. Microcontrollers that run on their RC oscillator are within 1 % at 25 °C
    and within 4 % from −10 to 85 °C (STM32F427, datasheet DS9405, "HSI oscillator characteristics"): what differs by
    more is no vehicle's clock, but a simulation that runs at another speed."""
    bin_us: int = 2 * _S
    """The least delay of each such span is kept. Raise for rare messages."""
    bins: int = 60
    """Spans remembered. Raise for a steadier drift, lower to follow temperature."""
    fit_after_us: int = 20 * _S
    """Drift is taken as 0 until the points span this much."""
    known_after_us: int = 60 * _S
    """And is worth telling from here on: over less, the delays of a busy host look like hundreds of ppm."""
    sure: float = 150e-6
    """By how much a half's drift may differ from the whole's. Raise for jittery links."""
    late_us: int = 5 * _S
    """A delay beyond this is either a late copy or a step of the host's clock."""
    early_us: int = _S
    """Arrival this much earlier than possible is a step of the host's clock, or a damaged time."""
    step_hold_us: int = 3 * _S
    """A step is believed when it has lasted this long."""
    steps_within_us: int = 60 * _S
    """Three steps within this, and the vehicle's clock is not followed any more."""
    back_us: int = _S
    """Boot time going back by more than this is a reboot or a late copy."""
    reboot_hold_us: int = 250_000
    """A reboot is believed when the new count has run on for this long."""
    reboot_below_us: int = 300 * _S
    """A vehicle that has just rebooted counts less than this."""
    reboot_fresh_us: int = 15 * _S
    """And less than this when its count is also that of a link so much later than another."""
    late_most_us: int = 60 * _S
    """No link is later than this."""
    late_hold_us: int = 15 * _S
    """When nothing but late messages has come for this long, they are all there is: their link counts as the way."""


@dataclass(slots=True)
class _Line:
    """Messages whose boot times fit each other and not the clock."""

    offset_us: int
    first_us: int
    last_us: int
    count: int


@dataclass(frozen=True, slots=True)
class _Past:
    """The clock before a restart."""

    newest_us: int
    """Boot time of its newest message."""
    offset_us: int
    """Arrival less boot time."""
    end_us: int
    """Arrival of the message that ended it."""
    lives: bool
    """The vehicle has not rebooted: the clock is that of a faster link, which may come back."""


class VehicleClock:
    """Learns one vehicle's clock. Boot times are unwrapped (they wrap after 49.7 days) and in µs once inside."""

    def __init__(self, params: ClockParams | None = None) -> None:
        self.params = params or ClockParams()
        self.reboots = 0
        """How often the vehicle's count started anew."""
        self.epoch = 0
        """Changes whenever boot times before and after cannot be compared: a reboot, or a clock given up."""
        self.restarts = 0
        """Changes whenever boot times are mapped anew: what came before keeps the Unix time it was given then."""
        self.stray = False
        """Whether the last boot time did not fit: a late copy, another sender, or a reboot not yet believed."""
        self.late = False
        """Whether it did not fit because it came late: it is of this count, or of the one before the last reboot."""
        self._frozen = 0
        self._by_arrival = False
        self._steps: deque[int] = deque(maxlen=3)
        self._started = False
        self._past = _Past(0, 0, 0, lives=False)
        self._restart(0, 0)

    def _restart(self, boot_us: int, arrival_us: int) -> None:
        self.restarts += 1
        self._newest = boot_us
        self._newest_arrival = arrival_us
        self._offset = float(arrival_us - boot_us)  # of the line, at _anchor
        self._anchor = boot_us
        self._drift = 0.0
        self._bins: deque[tuple[int, int]] = deque(maxlen=self.params.bins)
        self._bin_stop = boot_us + self.params.bin_us
        self._least = (boot_us, arrival_us - boot_us)
        self._delay_us = 20_000.0
        self._measured = False
        self._lines: list[_Line] = []
        self._astray_us = 0  # arrival of the first message in a row that did not fit

    def to_unix_us(self, boot_ms: int, arrival_us: int) -> int:
        """Learns from one message and says when it was made, Unix µs."""
        return self.unix_of(self.learn(boot_ms, arrival_us))

    def learn(self, boot_ms: int, arrival_us: int, *, trails: bool = False) -> int:
        """Learns from one message and returns its boot time, unwrapped, µs.

        Args:
            boot_ms: as sent.
            arrival_us: Unix µs.
            trails: its link is known to be later than another, so that it tells of no reboot.

        A sender that leaves its boot time at zero has none, and one that cannot be followed (a simulator that runs
        at another speed) has none that helps: their messages count by their arrival.
        """
        self._frozen = self._frozen + 1 if boot_ms == 0 else 0
        if not self._by_arrival and self._frozen >= 3:
            self._give_up(arrival_us)
        boot_us = arrival_us if self._by_arrival else self._unwrap(boot_ms * _MS, arrival_us)
        if not self._started:
            self._started = True
            self._restart(boot_us, arrival_us)
            return boot_us
        late_us = arrival_us - self.unix_of(boot_us)
        back = boot_us < self._newest - self.params.back_us
        self.stray = back or late_us > self.params.late_us or late_us < -self.params.early_us
        self.late = self.stray and self._is_late(boot_us, arrival_us, late_us)
        if self.stray:
            self._consider(boot_us, arrival_us, trails)
            boot_us = arrival_us if self._by_arrival else boot_us
        else:
            self._lines.clear()
            self._astray_us = 0
            self._take(boot_us, arrival_us, late_us)
        return boot_us

    def quicken(self, boot_us: int, arrival_us: int) -> None:
        """Follows a message of the same count that came over a quicker link: what came so far was late."""
        self._past = _Past(self._newest, round(self._line(self._newest)), arrival_us, lives=True)
        self.stray = self.late = False
        self._restart(boot_us, arrival_us)

    def forget(self) -> None:
        """Begins anew, for a vehicle whose clock was another's."""
        self._started = self._by_arrival = self.stray = self.late = False
        self._frozen = 0
        self._steps.clear()
        self._past = _Past(0, 0, 0, lives=False)
        self.epoch += 1
        self._restart(0, 0)

    def unix_of(self, boot_us: int) -> int:
        """Unix µs of a boot time."""
        return boot_us + round(self._offset + self._drift * (boot_us - self._anchor))

    def boot_of(self, t_us: int) -> int:
        """Boot time of a Unix time: the inverse of :meth:`unix_of` to a µs."""
        since_us = t_us - self._anchor - self._offset
        return self._anchor + round(since_us / (1.0 + self._drift))

    @property
    def drift(self) -> float:
        """Seconds that Unix time gains on the vehicle's clock per second, 0 before it can be told."""
        return self._drift

    @property
    def drift_known(self) -> bool:
        """Whether the drift was measured: long enough, not of a sender without a clock, nor cut to what is believed."""
        return self._measured and not self._by_arrival and abs(self._drift) != self.params.max_drift

    @property
    def drift_sure(self) -> bool:
        """Whether both halves of what is remembered drift alike: a link that became slower looks like a drift too."""
        return self.drift_known and self._halves_drift_by(self._drift)

    def _halves_drift_by(self, drift: float) -> bool:
        points = list(self._bins)
        halves = points[: len(points) // 2], points[len(points) // 2 :]
        return all(abs(_hull_slope(half) - drift) <= self.params.sure for half in halves)

    @property
    def uncertainty_s(self) -> float:
        """How far off times may be, 1σ in seconds, without the link's least delay."""
        if len(self._bins) < 5:
            return 0.001 + self._delay_us * 1e-6
        delays = sorted(d - self._line(b) for b, d in self._bins)
        return 0.001 + delays[len(delays) // 2] * 1e-6

    def _line(self, boot_us: int) -> float:
        return self._offset + self._drift * (boot_us - self._anchor)

    def _unwrap(self, boot_us: int, arrival_us: int) -> int:
        if not self._started:
            return boot_us
        expected = self._newest + arrival_us - self._newest_arrival
        wraps = (expected - boot_us + _WRAP_US // 2) // _WRAP_US
        near = boot_us + wraps * _WRAP_US
        # A reboot is far from what was expected either way: then the count as it came is the smaller surprise.
        return near if abs(near - expected) < 600 * _S else boot_us

    def _take(self, boot_us: int, arrival_us: int, late_us: int) -> None:
        self._delay_us += 0.02 * (max(late_us, 0) - self._delay_us)
        if boot_us > self._newest:
            self._newest, self._newest_arrival = boot_us, arrival_us
        delay = arrival_us - boot_us
        if late_us < 0:
            self._offset += late_us  # nothing arrives before it is sent
        if delay - self._line(boot_us) < self._least[1] - self._line(self._least[0]):
            self._least = (boot_us, delay)
        if boot_us >= self._bin_stop:
            self._bins.append(self._least)
            self._least = (boot_us, delay)
            self._bin_stop = boot_us + self.params.bin_us
            self._fit()

    def _fit(self) -> None:
        """The line under the points of all bins that is closest to them."""
        points = list(self._bins)
        span_us = points[-1][0] - points[0][0]
        if span_us >= self.params.fit_after_us:
            self._measured = span_us >= self.params.known_after_us
            self._drift = self._believed(_hull_slope(points))
        self._anchor = points[-1][0]
        self._offset = min(d - self._drift * (b - self._anchor) for b, d in points)
        if not self._drift:
            # without a drift the old points say less and less: each may be off by the greatest drift since
            self._offset = min(d + self.params.max_drift * (self._anchor - b) for b, d in points)

    def _believed(self, slope: float) -> float:
        """A fitted drift, cut to what is believed of one that is not sure."""
        params = self.params
        if params.max_drift < abs(slope) <= params.max_sure_drift and self._measured:
            followed = abs(self._drift) > params.max_drift and abs(slope - self._drift) <= params.sure
            if followed or self._halves_drift_by(slope):
                return slope
        return max(-params.max_drift, min(params.max_drift, slope))

    def _is_late(self, boot_us: int, arrival_us: int, late_us: int) -> bool:
        if arrival_us < self._newest_arrival - self.params.early_us:
            return False  # the host's clock went back, or two recordings were put together
        if 0 < late_us <= self.params.late_most_us and boot_us <= self._newest:
            return True
        past, most_us = self._past, self.params.late_most_us
        if past.lives and boot_us > self._newest:
            return False  # the quicker link is back
        made = past.lives or boot_us <= max(past.newest_us, past.end_us - past.offset_us)
        if not 0 <= arrival_us - past.end_us <= most_us or not made:
            return False
        return -self.params.early_us <= arrival_us - boot_us - past.offset_us <= most_us

    def _consider(self, boot_us: int, arrival_us: int, trails: bool) -> None:
        """Collects messages on other time lines, and moves to one once it has run without ours for long enough."""
        self._astray_us = self._astray_us or arrival_us
        line = self._line_of(boot_us, arrival_us)
        steady = arrival_us - line.first_us >= self.params.step_hold_us
        if arrival_us - self._astray_us > 2 * self.params.step_hold_us and not (steady or trails):
            self.stray = False
            self._give_up(arrival_us)
            return
        rebooted = boot_us < self._newest - self.params.back_us and boot_us < self.params.reboot_below_us
        rebooted = rebooted and not trails and (not self.late or boot_us < self.params.reboot_fresh_us)
        hold_us = self._hold_us(rebooted)
        if line.count >= 3 and arrival_us - line.first_us >= hold_us:
            self.reboots += rebooted
            lives = self.late and not rebooted
            self._past = _Past(self._newest, round(self._line(self._newest)), arrival_us, lives=lives)
            self.epoch += boot_us < self._newest - self.params.back_us
            self.stray = False
            self._restart(boot_us, arrival_us)
            if not rebooted:
                self._note_step(arrival_us)

    def _hold_us(self, rebooted: bool) -> int:
        if rebooted:
            return self.params.reboot_hold_us
        return self.params.late_hold_us if self.late else self.params.step_hold_us

    def _line_of(self, boot_us: int, arrival_us: int) -> _Line:
        """The other time line that this message is on; late copies may run beside a reboot."""
        self._lines = [line for line in self._lines if 0 <= arrival_us - line.last_us <= _LINE_US][-_LINES:]
        offset_us = arrival_us - boot_us
        for line in self._lines:
            if abs(offset_us - line.offset_us) <= _S // 2:
                line.last_us = arrival_us
                line.count += 1
                return line
        line = _Line(offset_us, arrival_us, arrival_us, 1)
        self._lines.append(line)
        return line

    def _note_step(self, arrival_us: int) -> None:
        steps = self._steps
        steps.append(arrival_us)
        if len(steps) == steps.maxlen and 0 <= arrival_us - steps[0] < self.params.steps_within_us:
            self._give_up(arrival_us)

    def _give_up(self, arrival_us: int) -> None:
        """From now on messages count by their arrival."""
        self._by_arrival = True
        self.epoch += 1
        self._restart(arrival_us, arrival_us)


def _hull_slope(points: list[tuple[int, int]]) -> float:
    """Slope of the lower convex hull's edge over the points' mean abscissa; points in order."""
    hull: list[tuple[int, int]] = []
    for x, y in points:
        while len(hull) >= 2:
            (x0, y0), (x1, y1) = hull[-2], hull[-1]
            # the middle point lies on or above the chord: it is not a corner of the lower hull
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    mean = sum(x for x, _ in points) / len(points)
    for (x0, y0), (x1, y1) in pairwise(hull):
        if x0 <= mean <= x1 and x1 > x0:
            return (y1 - y0) / (x1 - x0)
    return 0.0
