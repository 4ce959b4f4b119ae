import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavlink.estimation.clock import ClockFit, ClockParams, VehicleClock
from mavlink.estimation.clock_health import ClockHealth

T0 = 1_790_000_000_000_000
S = 1_000_000


class ObservedClock(VehicleClock):
    """A clock that keeps what its messages showed."""

    reboots = 0
    fit = ClockFit.FITS

    def add_message(self, boot_ms, arrival_us, *, trails=False):
        reading = super().add_message(boot_ms, arrival_us, trails=trails)
        self.reboots += reading.rebooted
        self.fit = reading.fit
        return reading

    def unix_us(self, boot_ms, arrival_us):
        return self.unix_of(self.add_message(boot_ms, arrival_us).boot_us)


class Vehicle:
    """A clock that drifts, behind a link that delays: the truth that the learnt one is compared with."""

    def __init__(self, seed=0, *, drift=0.0, booted_us=T0 - 60 * S, least_delay_us=2000, jitter_us=4000):
        self.rng = random.Random(seed)
        self.drift, self.booted_us = drift, booted_us
        self.least_delay_us, self.jitter_us = least_delay_us, jitter_us

    def boot_ms(self, t_us):
        return int((t_us - self.booted_us) / (1.0 + self.drift) / 1000)

    def message(self, t_us):
        return self.boot_ms(t_us), t_us + self.least_delay_us + int(self.rng.expovariate(1 / self.jitter_us))


def run(clock, vehicle, start_us, seconds, rate=10):
    errors = []
    for i in range(int(seconds * rate)):
        t_us = start_us + i * S // rate
        errors.append(clock.unix_us(*vehicle.message(t_us)) - t_us)
    return errors


@given(drift=st.floats(-400e-6, 400e-6), seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_error_stays_within_a_few_ms_under_drift_and_jitter(drift, seed):
    clock = ObservedClock()
    errors = run(clock, Vehicle(seed, drift=drift), T0, 120)
    assert max(map(abs, errors[-600:])) < 8000
    assert clock.drift == pytest.approx(drift, abs=60e-6)
    assert clock.reboots == 0 and clock.fit.fits


def test_first_message_is_as_good_as_its_arrival():
    clock = ObservedClock()
    assert clock.unix_us(5000, T0) == T0


def test_late_packets_do_not_move_the_clock():
    clock, vehicle = ObservedClock(), Vehicle(1, jitter_us=1000)
    run(clock, vehicle, T0, 60)
    boot_ms = vehicle.boot_ms(T0 + 60 * S)
    assert clock.unix_us(boot_ms, T0 + 62 * S) == pytest.approx(T0 + 60 * S, abs=5000)
    assert clock.unix_us(boot_ms + 100, T0 + 70 * S) == pytest.approx(T0 + 60 * S + 100_000, abs=5000)


def test_earlier_than_ever_moves_it_at_once():
    clock, vehicle = ObservedClock(), Vehicle(1, least_delay_us=60_000, jitter_us=1)
    run(clock, vehicle, T0, 3)
    vehicle.least_delay_us = 1000
    assert abs(run(clock, vehicle, T0 + 3 * S, 1)[-1]) < 3000


def test_boot_time_and_unix_time_are_inverse():
    clock = ObservedClock()
    run(clock, Vehicle(3, drift=150e-6), T0, 90)
    for t_us in (T0, T0 + 45 * S + 7, T0 + 100 * S):
        assert clock.unix_of(clock.boot_of(t_us)) == pytest.approx(t_us, abs=1)


def test_a_drift_is_known_when_it_was_measured_for_a_minute():
    clock, vehicle = ObservedClock(), Vehicle(3, drift=400e-6)
    run(clock, vehicle, T0, 50)
    assert clock.drift and not clock.drift_known
    run(clock, vehicle, T0 + 50 * S, 20)
    assert clock.drift_known


@pytest.mark.parametrize("after_s", [70, 90, 110])
def test_a_link_that_becomes_slower_is_no_sure_drift(after_s):
    clock, vehicle = ObservedClock(), Vehicle(3, drift=130e-6)
    run(clock, vehicle, T0, 130)
    vehicle.least_delay_us = 80_000
    run(clock, vehicle, T0 + 130 * S, after_s)
    assert clock.drift > 300e-6 and not clock.drift_sure
    run(clock, vehicle, T0 + (130 + after_s) * S, 200 - after_s)
    assert clock.drift == pytest.approx(130e-6, abs=60e-6) and clock.drift_sure


def test_a_fast_drift_is_sure():
    clock = ObservedClock()
    run(clock, Vehicle(3, drift=400e-6), T0, 120)
    assert clock.drift_sure


def test_reboot_is_seen_within_half_a_second():
    clock, vehicle = ObservedClock(), Vehicle(2)
    run(clock, vehicle, T0, 60)
    vehicle.booted_us = T0 + 61 * S
    errors = run(clock, vehicle, T0 + 62 * S, 20)
    assert clock.reboots == 1
    assert max(map(abs, errors[5:])) < 30_000


def test_copies_ten_seconds_late_are_no_reboot():
    clock, vehicle = ObservedClock(), Vehicle(4)
    run(clock, vehicle, T0, 30)
    for i in range(100):
        t_us = T0 + 30 * S + i * 100_000
        late_boot, _ = vehicle.message(t_us - 10 * S)
        clock.add_message(late_boot, t_us)
        assert clock.fit is ClockFit.LATE
        assert clock.unix_us(*vehicle.message(t_us)) == pytest.approx(t_us, abs=40_000)
        assert clock.fit.fits
    assert clock.reboots == 0


def test_wrap_after_49_days():
    wrap_us = (1 << 32) * 1000
    vehicle = Vehicle(5, booted_us=T0 + 30 * S - wrap_us)
    clock = ObservedClock()
    errors = []
    for i in range(600):
        t_us = T0 + i * 100_000
        boot_ms, arrival_us = vehicle.message(t_us)
        errors.append(clock.unix_us(boot_ms % (1 << 32), arrival_us) - t_us)
    assert max(map(abs, errors[5:])) < 30_000
    assert clock.reboots == 0


@pytest.mark.parametrize("step_s", [-3600, 3600])
def test_step_of_the_host_clock_is_followed(step_s):
    clock, vehicle = ObservedClock(), Vehicle(6)
    run(clock, vehicle, T0, 30)
    for i in range(100):
        t_us = T0 + 30 * S + i * 100_000
        boot_ms, arrival_us = vehicle.message(t_us)
        got = clock.unix_us(boot_ms, arrival_us + step_s * S)
    assert got == pytest.approx(t_us + step_s * S, abs=40_000)
    assert clock.reboots == 0


def test_one_damaged_arrival_time_changes_nothing():
    clock, vehicle = ObservedClock(), Vehicle(7)
    run(clock, vehicle, T0, 30)
    boot_ms, arrival_us = vehicle.message(T0 + 30 * S)
    clock.unix_us(boot_ms, arrival_us - 500 * S)
    clock.unix_us(boot_ms + 1, arrival_us + 500 * S)
    assert max(map(abs, run(clock, vehicle, T0 + 31 * S, 5))) < 40_000


def test_two_recordings_in_one_are_a_reboot():
    clock = ObservedClock()
    run(clock, Vehicle(9, booted_us=T0 - 39 * S), T0, 523)
    errors = run(clock, Vehicle(10, booted_us=T0 - 30 * S), T0 + 2 * S, 20)
    assert clock.reboots == 1
    assert max(map(abs, errors[10:])) < 30_000


def test_a_slow_link_alone_is_no_reboot_and_not_followed_at_once():
    clock, vehicle = ObservedClock(), Vehicle(11)
    run(clock, vehicle, T0, 60)
    for i in range(200):
        t_us = T0 + 60 * S + i * 100_000
        clock.add_message(vehicle.boot_ms(t_us - 10 * S), t_us)
        if i < 95:
            assert clock.fit is ClockFit.LATE
    assert clock.reboots == 0
    assert max(map(abs, run(clock, vehicle, T0 + 90 * S, 20)[-100:])) < 40_000  # the fast one is back


def test_sender_without_boot_time_counts_by_arrival():
    clock = ObservedClock()
    for i in range(100):
        t_us = clock.unix_us(0, T0 + i * 100_000)
        if i >= 3:
            assert t_us == T0 + i * 100_000
    assert clock.boot_of(T0 + 7 * S) == T0 + 7 * S


def test_parameters_bound_the_drift():
    clock = ObservedClock(ClockParams(max_drift=50e-6))
    run(clock, Vehicle(8, drift=200e-6), T0, 60)
    assert clock.drift <= 50e-6


@pytest.mark.parametrize("speed", [0.2, 0.5, 2, 5, 50])
def test_simulator_at_another_speed_counts_by_arrival(speed):
    clock = ObservedClock()
    for i in range(400):
        arrival_us = T0 + i * 100_000
        t_us = clock.unix_us(10_000 + int(i * 100 * speed), arrival_us)
        if i > 250:
            assert t_us == arrival_us and clock.fit.fits
    assert clock.reboots == 0


@pytest.mark.parametrize("ppm", [-40_000, -2000, -800, 800, 2000, 40_000])
def test_a_clock_that_no_crystal_has_is_followed_once_it_is_sure(ppm):
    clock, vehicle = ObservedClock(), Vehicle(3, drift=ppm * 1e-6)
    run(clock, vehicle, T0, 100)
    assert clock.drift == pytest.approx(ppm * 1e-6, abs=60e-6) and clock.drift_sure and clock.reboots == 0
    assert max(map(abs, run(clock, vehicle, T0 + 100 * S, 60))) < 8000


class Simulator:
    """A clock that runs at a rate, which may be another from some time on, behind a link that delays."""

    def __init__(self, rates, seed=4):
        self.rates, self.rng = rates, random.Random(seed)

    def messages(self, seconds, rate=5):
        boot_s = 30.0
        for i in range(seconds * rate):
            t_s = i / rate
            boot_s += [value for since_s, value in self.rates if t_s >= since_s][-1] / rate
            yield int(boot_s * 1000), T0 + int((t_s + 0.002 + self.rng.expovariate(250)) * S)


RATES = [0.3, 0.5, 0.7, 0.9, 0.94, 0.97, 1.03, 1.06, 1.2, 1.5, 2.0]


@pytest.mark.parametrize("rate", RATES)
def test_a_simulator_at_another_rate_is_dated_right_within_twenty_seconds(rate):
    """From then on positions are dated by arrival, or by the rate; until then they are a second off at most."""
    clock, noticed_s, errors = ObservedClock(), None, []
    for boot_ms, arrival_us in Simulator([(0.0, rate)]).messages(120):
        errors.append((clock.unix_us(boot_ms, arrival_us) - arrival_us) * 1e-6)
        if noticed_s is None and (clock.off_rate or abs(clock.drift) > 0.02):
            noticed_s = (arrival_us - T0) * 1e-6
    assert noticed_s is not None and 8.0 <= noticed_s <= 20.0
    assert max(map(abs, errors[20 * 5 :])) < 0.05
    assert clock.reboots == 0
    assert ClockHealth().fault(clock) or (abs(clock.drift) < 0.05 and clock.drift_known)


def test_a_rate_that_changes_is_dated_by_arrival_all_the_same():
    rates = [(0.0, 1.0), (40.0, 0.9), (60.0, 0.6), (90.0, 0.95), (120.0, 0.8)]
    clock, told = ObservedClock(), []
    for boot_ms, arrival_us in Simulator(rates).messages(180):
        error_s = (clock.unix_us(boot_ms, arrival_us) - arrival_us) * 1e-6
        fault = ClockHealth().fault(clock)
        told += [fault] if fault and (not told or told[-1] != fault) else []
        if arrival_us > T0 + 60 * S:
            assert abs(error_s) < 0.05
    assert len(told) == 1 and "% of real time" in told[0]


def test_a_clock_that_runs_right_again_is_followed_again():
    clock = ObservedClock()
    for boot_ms, arrival_us in Simulator([(0.0, 0.8), (60.0, 1.0)]).messages(150):
        clock.unix_us(boot_ms, arrival_us)
        assert clock.off_rate or not 20 * S < arrival_us - T0 < 100 * S
    assert clock.off_rate == 0.0 and ClockHealth().fault(clock) == ""


@pytest.mark.parametrize("delay_s", [0.3, 1.0, 4.0])
def test_a_link_whose_queue_fills_is_no_other_rate(delay_s):
    """Within seconds, and stays full: the vehicle's clock runs as before."""
    clock, vehicle = ObservedClock(), Vehicle(5)
    for i in range(1200):
        boot_ms, arrival_us = vehicle.message(T0 + i * S // 10)
        late_s = delay_s * min(max(i / 10 - 40.0, 0.0) / 4.0, 1.0)
        clock.unix_us(boot_ms, arrival_us + int(late_s * S))
        assert clock.off_rate == 0.0


def test_a_drift_beyond_any_clock_is_not_followed():
    clock = ObservedClock()
    run(clock, Vehicle(3, drift=-0.06), T0, 120)
    assert not clock.drift_known and abs(clock.drift) <= clock.params.max_drift
