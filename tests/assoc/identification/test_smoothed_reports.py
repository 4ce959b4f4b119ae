"""Trackers that smooth what they report: behind in every turn, and smoother than they are precise."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import Fleet, play

IDS = (11, 12, 13, 14, 15)
SPEED_MPS = 3.5


@dataclass
class Smoothed(Fleet):
    """Vehicles that turn at corners; positions and velocities go through a low-pass filter of first order."""

    tau_s: float = 0.9

    def __post_init__(self):
        super().__post_init__()
        rng = np.random.default_rng(self.seed)
        self.leg_m = rng.uniform(4.0, 9.0, (self.n, 12))
        turn = np.deg2rad(rng.choice([-1.0, 1.0], (self.n, 12)) * rng.uniform(60.0, 150.0, (self.n, 12)))
        self.course = rng.uniform(0.0, 2.0 * np.pi, (self.n, 1)) + np.cumsum(turn, axis=1)
        self.before = {}

    def at(self, t):
        corner_m = np.pad(np.cumsum(self.leg_m, axis=1), ((0, 0), (1, 0)))
        way = np.stack([np.sin(self.course), np.cos(self.course)], axis=2)
        driven_m = np.clip(max(t, 0.0) * SPEED_MPS - corner_m[:, :-1], 0.0, self.leg_m)
        leg = np.count_nonzero(driven_m > 0.0, axis=1).clip(1) - 1
        return self.start + (way * driven_m[:, :, None]).sum(axis=1), SPEED_MPS * way[np.arange(self.n), leg]

    def reports(self, start, stop, rng):
        true = super().reports(start, stop, rng)
        place, speed, keep = true.p_enu.copy(), true.v_enu.copy(), np.exp(-1.0 / self.rate_hz / self.tau_s)
        for k, vehicle in enumerate(true.vehicle.tolist()):
            before = self.before.get(vehicle, (place[k], speed[k]))
            place[k], speed[k] = (keep * a + (1.0 - keep) * b[k] for a, b in zip(before, (place, speed), strict=True))
            self.before[vehicle] = place[k], speed[k]
        return replace(true, p_enu=place, v_enu=speed, heading=np.arctan2(speed[:, 0], speed[:, 1]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_vehicles_that_smooth_their_positions_over_a_second_are_named(seed):
    answers = play(Identifier(IDS), Smoothed(n=5, seed=seed, spacing_m=8.0, white_m=0.3), 14.0)
    names = np.array([answer.system_id for t, answer in answers if t >= 9.0])
    assert (names == IDS).mean() > 0.97
    assert not ((names != IDS) & (names > 0)).any()
