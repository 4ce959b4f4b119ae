"""Two clocks that contradict each other: of one file, and of a vehicle in a log of its own and in the telemetry."""

import re

import numpy as np
import pytest

from gcs.importing.checks.two_clocks import clock_lead
from gcs.importing.ground_vehicles import clock_words
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog

T_S = np.arange(0.0, 60.0, 0.2)


def track(t_s, moved=1.0, off_deg=0.0, noise_m=0.0):
    """On a winding path at 2 m/s, of which the times are late or early."""
    noise = np.random.default_rng(1).normal(0.0, noise_m / 111_320.0, (2, len(t_s)))
    north, east = 20.0 * np.sin(t_s / 10.0), 2.0 * t_s
    lat = 47.1 + off_deg + moved * north / 111_320.0 + noise[0]
    return PlaceTrack.of(np.rint(1.76e15 + T_S[: len(t_s)] * 1e6).astype(np.int64), lat, 8.1 + moved * east / 75_800.0)


def log_of(places):
    return VehicleLog(source="r11.bin", clock="utc", places=places, notes=ImportNotes())


@pytest.mark.parametrize("ahead_s", [-1.1, -0.3, 0.14, 0.5, 1.1])
def test_how_far_a_clock_is_ahead_is_told(ahead_s):
    # what the log dates t was at t − ahead
    (said,) = clock_words(log_of(track(T_S - ahead_s)), track(T_S, noise_m=0.1))
    assert said.startswith("r11.bin: its clock is")
    assert float(re.search(r"is ([-+][\d.]+) s ahead", said).group(1)) == pytest.approx(ahead_s, abs=0.03)


@pytest.mark.parametrize(
    ("t_s", "said"),
    [
        (T_S - 18.0, "18.00 s ahead of the telemetry of the same vehicle: "),
        (T_S + 18.0, "GPS time and UTC are 18 s apart; the log counts"),
        (T_S * 1.01, "ahead in the first half and "),
    ],
)
def test_leap_seconds_and_a_clock_that_runs_otherwise_are_told(t_s, said):
    (words,) = clock_words(log_of(track(t_s)), track(T_S, noise_m=0.1))
    assert said in words


@pytest.mark.parametrize(
    "telemetry",
    [
        track(T_S - 0.05),  # less than can be told of arrival
        track(T_S - 0.5, moved=0.01),  # who stands tells nothing
        track(T_S - 0.5, off_deg=0.01),  # another vehicle
        track(T_S[:5]),
    ],
)
def test_nothing_is_told_where_nothing_shows(telemetry):
    assert clock_words(log_of(track(T_S) if np.ptp(telemetry.lat_deg) > 1e-5 else track(T_S, 0.01)), telemetry) == ()


FIFTHS = np.arange(0, 60_000_000, 200_000)
SECONDS = np.arange(0, 60_000_000, 1_000_000)
DATE = 1_760_000_000_000_000


@pytest.mark.parametrize(
    ("t_us", "ahead_us", "said"),
    [
        (FIFTHS, 0, ""),
        (FIFTHS, 70_000 * (FIFTHS % 3 == 0), ""),  # lateness
        (FIFTHS, 2e-4 * FIFTHS, ""),  # crystals
        (SECONDS, 0, ""),  # a receiver that tells each second
        (FIFTHS, 100_000 * (FIFTHS > 30_000_000), "date steps by +0.10 s at 30.2 s: what holds longest counts"),
        (FIFTHS, -3e-3 * FIFTHS, "date runs 0.30% slower than film: they drift apart by 0.18 s"),
        (FIFTHS, -(FIFTHS % 1_000_000), "date is cut to whole seconds: ±0.10 s"),
        (FIFTHS, 808 - FIFTHS % 1_000_000, "date is cut to whole seconds: ±0.10 s"),
    ],
)
def test_a_date_beside_another_clock(t_us, ahead_us, said):
    lead = clock_lead("date", "film", DATE + t_us + np.rint(ahead_us).astype(np.int64), t_us)
    assert lead.notes == ((said,) if said else ())
    assert np.abs(np.median(lead.longest_us) - DATE) <= 101_000


def test_dates_of_whole_seconds_a_second_apart_are_cut_in_subtitles():
    t_us = SECONDS + SECONDS // 50
    lead = clock_lead("date", "film", DATE + t_us // 1_000_000 * 1_000_000, t_us, cut=True)
    assert lead.notes == ("date is cut to whole seconds: ±0.50 s",)
