"""Attitude between and after its samples, against a body whose motion is known."""

import math

import numpy as np
import pytest

from mavlink.estimation.interpolation import ATTITUDE_LOST_S, Attitudes
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude

S = 1_000_000
SWAY, SWAY_S, TURN = math.radians(4.0), 1.5, math.radians(20.0)
"""Amplitude and period of roll and pitch, and the turning rate."""


def angles(t):
    """Roll, pitch and yaw at t seconds; yaw passes π."""
    w = 2.0 * math.pi / SWAY_S
    return SWAY * math.sin(w * t), 0.1 + SWAY * math.cos(0.8 * w * t), wrap_pi(3.0 + TURN * t)


def body_rates(t):
    """p = φ̇ − ψ̇ sin θ,  q = θ̇ cos φ + ψ̇ sin φ cos θ,  r = −θ̇ sin φ + ψ̇ cos φ cos θ."""
    w = 2.0 * math.pi / SWAY_S
    (roll, pitch, _), roll_rate = angles(t), SWAY * w * math.cos(w * t)
    pitch_rate = -SWAY * 0.8 * w * math.sin(0.8 * w * t)
    return (
        roll_rate - TURN * math.sin(pitch),
        pitch_rate * math.cos(roll) + TURN * math.sin(roll) * math.cos(pitch),
        -pitch_rate * math.sin(roll) + TURN * math.cos(roll) * math.cos(pitch),
    )


def reported(rate_hz, scale=1.0, stop_s=6.0):
    attitudes = Attitudes()
    for t in np.arange(0.0, stop_s, 1.0 / rate_hz):
        roll, pitch, yaw = angles(t)
        rates = (scale * rate for rate in body_rates(t))
        assert attitudes.add(round(t * S), Attitude(round(t * S), 1, 1, round(t * 1000), roll, pitch, yaw, *rates))
    return attitudes


def worst_deg(attitudes, times):
    off = [abs(wrap_pi(a - b)) for t in times for a, b in zip(attitudes.at(round(t * S))[:3], angles(t), strict=True)]
    return math.degrees(max(off))


BETWEEN = np.arange(0.5, 5.0, 0.013)


@pytest.mark.parametrize(("rate_hz", "limit_deg"), [(4, 0.1), (5, 0.05), (20, 0.002)])
def test_rates_determine_the_path_between_samples(rate_hz, limit_deg):
    with_rates, without = worst_deg(reported(rate_hz), BETWEEN), worst_deg(reported(rate_hz, 0.0), BETWEEN)
    assert with_rates < limit_deg
    assert 5.0 * with_rates < without < 1.0


@pytest.mark.parametrize("scale", [180.0 / math.pi, -10.0])
def test_rates_that_do_not_fit_the_angles_are_left_out(scale):
    assert worst_deg(reported(5, scale), BETWEEN) == pytest.approx(worst_deg(reported(5, 0.0), BETWEEN))


def test_at_the_samples_it_is_what_was_reported():
    assert worst_deg(reported(5), np.arange(0.4, 5.0, 0.2)) < 1e-9


def test_far_apart_rates_say_nothing_of_the_path():
    assert worst_deg(reported(1.5), BETWEEN) == pytest.approx(worst_deg(reported(1.5, 0.0), BETWEEN))


def test_after_the_last_sample_a_body_sways_back_and_turns_on():
    attitudes = Attitudes()
    attitudes.add(0, Attitude(0, 1, 1, 0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.3))
    soon, later = attitudes.at(50_000), attitudes.at(round(ATTITUDE_LOST_S * S))
    assert soon.roll == pytest.approx(0.5 * 0.05, rel=0.15)
    assert later.roll < 0.5 * 0.2 and later.yaw == pytest.approx(1.0 + 0.3 * ATTITUDE_LOST_S)
    assert attitudes.at(3 * S)[:3] == later[:3]
