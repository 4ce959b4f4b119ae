"""A vehicle's clock on Unix time, learnt from when its messages arrive.

With b the vehicle's boot time of a message and a its arrival, a − b = offset + drift · b + delay, delay ≥ 0: the offset
and the drift are those of the line that lies under all points as closely as it can (Moon, Skelly, Towsley, INFOCOM
1999, doi:10.1109/INFCOM.1999.749287: the edge of the lower convex hull over their mean). The least delay of the link
itself cannot be seen this way and stays in the offset. The vehicle's own Unix time is never used: it is often off by
a second.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

from mavlink.estimation.clock_rate import ClockRate

WRAP_US = (1 << 32) * 1000
"""Boot times are 32 bits of milliseconds: 49.7 days."""
STEEP, STEEP_WITHIN = 0.01, 0.1
"""A drift that a link's growing delays do not make within seconds, and by how much of it its halves may differ."""
_MS = 1000
_S = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockParams:
    """Bounds of how a vehicle's clock may behave."""

    max_drift: float = 500e-6
    """Greatest drift accepted of a fit that may be a link's doing. Crystals are within some tens of ppm, autopilots
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
    steep_after_us: int = 10 * _S
    """Except for one of 1 % and more that both halves show: it costs a second in a minute and a half."""
    known_after_us: int = 60 * _S
    """Time from which a drift is worth reporting: over less, the delays of a busy host look like hundreds of ppm."""
    sure: float = 150e-6
    """Largest difference of a half's drift from the whole's. Raise for jittery links."""
    late_us: int = 5 * _S
    """A delay beyond this is either a late copy or a step of the host's clock."""
    early_us: int = _S
    """Arrival this much earlier than possible is a step of the host's clock, or a damaged time."""
    step_hold_us: int = 3 * _S
    """A step is accepted when it has lasted this long."""
    steps_within_us: int = 60 * _S
    """Time within which three steps mean that the vehicle's clock is not followed any more."""
    back_us: int = _S
    """Boot time going back by more than this is a reboot or a late copy."""
    reboot_hold_us: int = 250_000
    """A reboot is accepted when the new count has run on for this long."""
    reboot_below_us: int = 300 * _S
    """A vehicle that has just rebooted counts less than this."""
    reboot_fresh_us: int = 15 * _S
    """Limit for a reboot when its count is also that of a link so much later than another."""
    reboot_surprise_us: int = 600 * _S
    """A boot time farther than this from what was expected, wrapped or not, is taken as it came: a reboot."""
    late_most_us: int = 60 * _S
    """Delay of the latest link."""
    late_hold_us: int = 15 * _S
    """Time of nothing but late messages after which the vehicle has no faster link: the clock follows them."""
    line_us: int = 5 * _S
    """Outliers no farther apart than this may be on one line."""
    line_width_us: int = _S // 2
    """Agreement of offsets that count as one line: more than the jitter of a radio."""
    lines: int = 4
    """Lines of outliers followed beside the clock: late copies may run beside a reboot."""
    line_messages: int = 3
    """Messages that make a line."""
    zero_times: int = 3
    """Boot times of 0 in a row that show a sender without a clock."""


class ClockFit(Enum):
    """Agreement of the boot time of one message with the clock; each as (fits, late)."""

    FITS = True, False
    """The message is on the clock's line."""
    LATE = False, True
    """The message came late: of this count, or of the one before the last reboot."""
    OUTLIER = False, False
    """The message fits neither: another sender, or a reboot or step that is not accepted yet."""
    FOLLOWED_LATE = True, True
    """The message came late, and the clock follows it from now on."""

    def __init__(self, fits: bool, late: bool) -> None:
        self.fits = fits
        """The boot time is one of this clock's."""
        self.late = late
        """The message came over a late link."""


class ClockReading(NamedTuple):
    """Reading that one message gives of the clock."""

    boot_us: int
    """Boot time of the message, unwrapped."""
    fit: ClockFit
    rebooted: bool = False
    """The vehicle has rebooted, as this message proves."""
    new_epoch: bool = False
    """Earlier boot times cannot be compared with this one: a reboot, or a sender whose clock is not followed."""


@dataclass(slots=True)
class _Line:
    """Messages whose boot times fit each other and not the clock."""

    offset_us: int
    first_us: int
    last_us: int
    count: int


@dataclass(frozen=True, slots=True)
class _FormerClock:
    """The clock before a restart."""

    newest_us: int
    """Boot time of its newest message."""
    offset_us: int
    """Arrival less boot time."""
    end_us: int
    """Arrival of the message that ended it."""
    valid: bool
    """The vehicle has not rebooted: the clock is that of a faster link, which may come back."""


_NO_FORMER_CLOCK = _FormerClock(0, 0, 0, valid=False)


class VehicleClock:
    """Learns one vehicle's clock. Boot times are unwrapped (they wrap after 49.7 days) and in µs once inside."""

    def __init__(self, params: ClockParams | None = None) -> None:
        self.params = params or ClockParams()
        self.epoch = 0
        """Changes whenever boot times before and after cannot be compared: a reboot, or a clock no longer followed."""
        self.restarts = 0
        """Changes whenever boot times are mapped again: what came before keeps the Unix time it was given then."""
        self.off_rate = 0.0
        """Rate of a clock that is not followed for it, 1 is as fast as ours; 0 for one that is."""
        self._rate = ClockRate()
        self._zero_times = 0
        self._by_arrival = False
        self._steps: deque[int] = deque(maxlen=3)
        self._started = False
        self._former = _NO_FORMER_CLOCK
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
        self._measured = False
        self._lines: list[_Line] = []
        self._outlier_since_us = 0  # arrival of the first message in a row that did not fit, 0 for none

    def add_message(self, boot_ms: int, arrival_us: int, *, trails: bool = False) -> ClockReading:
        """Learn from one message and return its boot time.

        A sender that leaves its boot time at zero has no clock, and one that cannot be followed (a simulator that runs
        at another speed) has none that helps: the boot time of their messages is their arrival.

        Args:
            arrival_us: Unix µs.
            trails: its link is known to be later than another, so that it cannot show a reboot.
        """
        epoch = self.epoch
        self._zero_times = self._zero_times + 1 if boot_ms == 0 else 0
        if not self._by_arrival and self._zero_times >= self.params.zero_times:
            self._fall_back_to_arrival(arrival_us)
        elif self._rate.add(boot_ms * _MS, arrival_us):
            self._heed_rate(arrival_us)
        boot_us = arrival_us if self._by_arrival else self._unwrap(boot_ms * _MS, arrival_us)
        if not self._started or self._newest == 0:  # a time that was left at zero anchors nothing
            self._started = True
            self._restart(boot_us, arrival_us)
            return ClockReading(boot_us, ClockFit.FITS, new_epoch=self.epoch != epoch)
        late_us = arrival_us - self.unix_of(boot_us)
        back = boot_us < self._newest - self.params.back_us
        if not (back or late_us > self.params.late_us or late_us < -self.params.early_us):
            self._lines.clear()
            self._outlier_since_us = 0
            self._add_point(boot_us, arrival_us, late_us)
            return ClockReading(boot_us, ClockFit.FITS, new_epoch=self.epoch != epoch)
        late = self._is_late(boot_us, arrival_us, late_us)
        followed, rebooted = self._add_outlier(boot_us, arrival_us, late, trails)
        if late:
            fit = ClockFit.FOLLOWED_LATE if followed else ClockFit.LATE
        else:
            fit = ClockFit.FITS if followed else ClockFit.OUTLIER
        boot_us = arrival_us if self._by_arrival else boot_us
        return ClockReading(boot_us, fit, rebooted=rebooted, new_epoch=self.epoch != epoch)

    @property
    def started(self) -> bool:
        """True if any message has anchored it."""
        return self._started

    def counts_otherwise(self, boot_ms: int, arrival_us: int) -> bool:
        """Tell whether a boot time is of another count: left at zero, or farther off than any link is late."""
        if not self._started or self._by_arrival:
            return False
        gap_us = (self.boot_of(arrival_us) - boot_ms * _MS) % WRAP_US
        return boot_ms == 0 or min(gap_us, WRAP_US - gap_us) > self.params.late_most_us

    @property
    def newest_us(self) -> int:
        """Latest boot time of any message, µs."""
        return self._newest

    def boot_at(self, boot_ms: int, arrival_us: int) -> int | None:
        """Boot time of a message that does not teach the clock; None where it is not one of this clock."""
        if not self._started or self._by_arrival:
            return None
        boot_us = self._unwrap(boot_ms * _MS, arrival_us)
        late_us = arrival_us - self.unix_of(boot_us)
        return boot_us if -self.params.early_us <= late_us <= self.params.late_us else None

    def follow_faster_link(self, reading: ClockReading, arrival_us: int) -> ClockReading:
        """Follow a message of the same count that came over a faster link: what came so far was late."""
        newest = self._newest
        self._former = _FormerClock(newest, round(self._line(newest)), arrival_us, valid=True)
        self._restart(reading.boot_us, arrival_us)
        return ClockReading(reading.boot_us, ClockFit.FITS)

    def reset(self) -> None:
        """Start again, for a vehicle whose clock was another's."""
        self._started = self._by_arrival = False
        self._zero_times = 0
        self.off_rate = 0.0
        self._rate.clear()
        self._steps.clear()
        self._former = _NO_FORMER_CLOCK
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
        """Seconds that Unix time gains on the vehicle's clock per second, 0 while unknown."""
        return self._drift

    @property
    def drift_known(self) -> bool:
        """True if the drift was measured: for long enough, of a sender with a clock, and not cut to the limit."""
        return self._measured and not self._by_arrival and abs(self._drift) != self.params.max_drift

    @property
    def drift_sure(self) -> bool:
        """True if both halves of what is remembered drift alike: a link that became slower looks like a drift too."""
        return self.drift_known and self._halves_drift_by(self._drift)

    def _halves_drift_by(self, drift: float) -> bool:
        points = list(self._bins)
        halves = points[: len(points) // 2], points[len(points) // 2 :]
        return all(abs(_hull_slope(half) - drift) <= self.params.sure for half in halves)

    def _line(self, boot_us: int) -> float:
        return self._offset + self._drift * (boot_us - self._anchor)

    def _unwrap(self, boot_us: int, arrival_us: int) -> int:
        if not self._started:
            return boot_us
        expected = self._newest + arrival_us - self._newest_arrival
        if abs(expected - boot_us) < WRAP_US // 2:
            return boot_us
        wraps = (expected - boot_us + WRAP_US // 2) // WRAP_US
        near = boot_us + wraps * WRAP_US
        # a reboot is far from what was expected either way: then the count as it came is the smaller surprise
        return near if abs(near - expected) < self.params.reboot_surprise_us else boot_us

    def _add_point(self, boot_us: int, arrival_us: int, late_us: int) -> None:
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
        slope = _hull_slope(points)
        if span_us >= self.params.steep_after_us and self._is_steep(slope):
            self._measured, self._drift = True, slope
        elif span_us >= self.params.fit_after_us:
            self._measured = span_us >= self.params.known_after_us
            self._drift = self._limited_drift(slope)
        self._anchor = points[-1][0]
        self._offset = min(d - self._drift * (b - self._anchor) for b, d in points)
        if not self._drift:
            # without a drift old points become less certain: each may be off by the greatest drift since
            self._offset = min(d + self.params.max_drift * (self._anchor - b) for b, d in points)

    def _is_steep(self, slope: float) -> bool:
        """Tell whether a drift is so large that both halves show it though little is remembered."""
        if not STEEP <= abs(slope) <= self.params.max_sure_drift:
            return False
        points = list(self._bins)
        halves = points[: len(points) // 2], points[len(points) // 2 :]
        return all(abs(_hull_slope(half) - slope) <= STEEP_WITHIN * abs(slope) for half in halves)

    def _heed_rate(self, arrival_us: int) -> None:
        """Stop following a clock that runs at another rate, and follow it again once it runs right."""
        if self._rate.is_off and not self.off_rate:
            self.off_rate = self._rate.rate
            if not self._by_arrival:
                self._fall_back_to_arrival(arrival_us)
        elif self.off_rate and self._rate.is_real:
            self.off_rate = 0.0
            self._by_arrival = self._started = False
            self.epoch += 1

    def _limited_drift(self, slope: float) -> float:
        """A fitted drift, cut to the limit where it is not sure."""
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
        former, most_us = self._former, self.params.late_most_us
        if former.valid and boot_us > self._newest:
            return False  # the faster link is back
        made = former.valid or boot_us <= max(former.newest_us, former.end_us - former.offset_us)
        if not 0 <= arrival_us - former.end_us <= most_us or not made:
            return False
        return -self.params.early_us <= arrival_us - boot_us - former.offset_us <= most_us

    def _add_outlier(self, boot_us: int, arrival_us: int, late: bool, trails: bool) -> tuple[bool, bool]:
        """Collect messages on other lines, and follow one once it has run without this clock's for long enough.

        Returns:
            Whether the clock follows this message now, and whether that is because of a reboot.
        """
        self._outlier_since_us = self._outlier_since_us or arrival_us
        line = self._line_of(boot_us, arrival_us)
        steady = arrival_us - line.first_us >= self.params.step_hold_us
        if arrival_us - self._outlier_since_us > 2 * self.params.step_hold_us and not (steady or trails):
            self._fall_back_to_arrival(arrival_us)
            return True, False
        back = boot_us < self._newest - self.params.back_us
        rebooted = back and boot_us < self.params.reboot_below_us
        rebooted = rebooted and not trails and (not late or boot_us < self.params.reboot_fresh_us)
        hold_us = self._hold_us(rebooted, late)
        if line.count < self.params.line_messages or arrival_us - line.first_us < hold_us:
            return False, False
        valid = late and not rebooted
        self._former = _FormerClock(self._newest, round(self._line(self._newest)), arrival_us, valid=valid)
        self.epoch += back
        self._restart(boot_us, arrival_us)
        if not rebooted:
            self._count_step(arrival_us)
        return True, rebooted

    def _hold_us(self, rebooted: bool, late: bool) -> int:
        if rebooted:
            return self.params.reboot_hold_us
        return self.params.late_hold_us if late else self.params.step_hold_us

    def _line_of(self, boot_us: int, arrival_us: int) -> _Line:
        """The line of outliers that this message is on."""
        params = self.params
        recent = [line for line in self._lines if 0 <= arrival_us - line.last_us <= params.line_us]
        self._lines = recent[-params.lines :]
        offset_us = arrival_us - boot_us
        for line in self._lines:
            if abs(offset_us - line.offset_us) <= params.line_width_us:
                line.last_us = arrival_us
                line.count += 1
                return line
        line = _Line(offset_us, arrival_us, arrival_us, 1)
        self._lines.append(line)
        return line

    def _count_step(self, arrival_us: int) -> None:
        steps = self._steps
        steps.append(arrival_us)
        if len(steps) == steps.maxlen and 0 <= arrival_us - steps[0] < self.params.steps_within_us:
            self._fall_back_to_arrival(arrival_us)

    def _fall_back_to_arrival(self, arrival_us: int) -> None:
        """Take the arrival of a message for its boot time from now on."""
        self._by_arrival = True
        self.epoch += 1
        self._restart(arrival_us, arrival_us)


class OtherClocks:
    """Clocks of a vehicle's messages that its autopilot's clock does not date.

    Components have their own, and what bridges a vehicle to MAVLink may date one kind of message by another count than
    the others, or leave its boot time at zero.

    Args:
        clock: the autopilot's.
    """

    def __init__(self, clock: VehicleClock) -> None:
        self._clock = clock
        self._clocks: dict[Hashable, VehicleClock] = {}
        self._dated: set[type] = set()
        """Kinds of message that the autopilot's clock has dated."""

    def clear(self) -> None:
        """Forget all, for a vehicle whose autopilot is another component now."""
        self._clocks.clear()
        self._dated.clear()

    def of_component(self, component_id: int) -> VehicleClock:
        """The clock by which a component dates its messages."""
        return self._clocks.setdefault(component_id, VehicleClock())

    def add_dated(self, kind: type) -> None:
        """Note that the autopilot's clock dates this kind of message."""
        self._dated.add(kind)

    def read(self, kind: type, component_id: int, boot_ms: int, arrival_us: int, *, own: bool) -> ClockReading | None:
        """Boot time, by the autopilot's clock, of a message that this clock does not date; None where it does.

        A kind that it has dated once is always its own: another count then is another sender's.

        Args:
            arrival_us: Unix µs.
            own: the autopilot sent it.
        """
        clock = self._clocks.get((component_id, kind))
        if clock is None:
            if own and (kind in self._dated or not self._clock.counts_otherwise(boot_ms, arrival_us)):
                return None
            clock = self._clocks[component_id, kind] = VehicleClock()
        reading = clock.add_message(boot_ms, arrival_us)
        made_us = clock.unix_of(reading.boot_us) if reading.fit.fits else arrival_us
        return ClockReading(self._clock.boot_of(made_us), reading.fit)


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
