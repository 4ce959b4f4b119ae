"""Names of ships that a camera on a bridge sees near the horizon: directions tell, distances do not."""

import numpy as np
import pytest

from assoc.hypotheses.marginals import exact_marginals, loopy_marginals
from assoc.identification.identifier import Identifier
from assoc.records import CameraState, Observation, VehicleReports

HEIGHT_M, PX_RAD, HALF_VIEW = 20.0, 4e-4, (0.5, 0.3)


def camera():
    """20 m up, looking north and 4° down, as it says."""
    c, s = np.cos(np.deg2rad(4.0)), np.sin(np.deg2rad(4.0))
    R = np.array([[1.0, 0.0, 0.0], [0.0, -s, c], [0.0, -c, -s]])
    return CameraState(
        R_enu_cam=R,
        p_enu=np.array([0.0, 0.0, HEIGHT_M]),
        ground_z=0.0,
        px_rad=PX_RAD,
        attitude_known=True,
        position_known=True,
        stabilized=True,
        half_view=HALF_VIEW,
    )


class Ships:
    """n ships between 500 and 1,500 m away, some under way, each with a report every few seconds."""

    def __init__(self, seed, n=8, every_s=(3.0, 20.0)):
        rng = self.rng = np.random.default_rng(seed)
        away, bearing = rng.uniform(500, 1500, n), rng.uniform(-0.45, 0.45, n)
        self.start = np.column_stack([away * np.sin(bearing), away * np.cos(bearing)])
        self.v = rng.uniform(-5, 5, (n, 2)) * (rng.random((n, 1)) < 0.7)
        self.next_s, self.every_s = -rng.uniform(0, 10, n), rng.uniform(*every_s, n)

    def at(self, t):
        return self.start + self.v * t

    def reports(self, t):
        """Those that are due by t."""
        rows = np.flatnonzero(self.next_s <= t)
        self.next_s[rows] = t + self.every_s[rows]
        p = self.at(t)[rows] + self.rng.normal(0, 5.0, (len(rows), 2))
        flat = np.zeros((len(rows), 1))
        return VehicleReports(
            t_us=np.full(len(rows), int(t * 1e6)),
            vehicle=rows,
            p_enu=np.hstack([p, flat]),
            v_enu=np.hstack([self.v[rows], flat]),
            heading=np.full(len(rows), np.nan),
            std_m=np.full(len(rows), np.nan),
        )

    def seen(self, t, who, yaw_deg, tilt_deg):
        """Boxes of some ships, by a camera whose heading and tilt are off; the k-th is track k + 1."""
        p = self.at(t)[who]
        bearing = np.arctan2(p[:, 0], p[:, 1]) - np.deg2rad(yaw_deg) + self.rng.normal(0, 3 * PX_RAD, len(p))
        down = np.arctan2(HEIGHT_M - 4.0, np.hypot(*p.T)) + np.deg2rad(tilt_deg)
        d = np.column_stack([np.sin(bearing) * np.cos(down), np.cos(bearing) * np.cos(down), -np.sin(down)])
        return Observation(
            t_us=int(t * 1e6),
            track_id=np.arange(1, len(who) + 1),
            ray_cam=d @ camera().R_enu_cam,
            front_cam=np.full((len(who), 3), np.nan),
            gap_s=np.zeros(len(who)),
            score=np.ones(len(who)),
            extent_rad=np.tile([0.05, 0.02], (len(who), 1)),
        )


def named(reporting, filmed, who, seconds, yaw_deg=2.0, tilt_deg=-0.8):
    """(frames, boxes) names and confidences of a film at one frame a second, and the identifier."""
    identifier = Identifier(range(11, 11 + len(reporting.start)))
    answers = []
    for t in np.arange(0.0, seconds):
        answer = identifier.update(filmed.seen(t, who, yaw_deg, tilt_deg), camera(), reporting.reports(t))
        answers.append((answer.system_id, answer.confidence))
    return *np.moveaxis(np.array(answers), 1, 0), identifier


@pytest.mark.slow
def test_ships_are_named_by_their_directions():
    who, share = np.array([1, 4, 6]), []
    for seed in range(6):
        ships = Ships(seed)
        got, sure, identifier = named(ships, ships, who, 60.0)
        right = got == 11 + who
        assert not np.any((got > 0) & ~right & (sure > 0.9))
        assert identifier.fit_probability > 0.99
        share.append(np.mean(right[20:]))
    # the others stand beside one another as the camera sees them
    assert np.mean(share) > 0.85
    assert np.median(share) == 1.0


def test_names_stay_at_ten_frames_a_second():
    ships, who = Ships(1), np.array([1, 4, 6])
    identifier = Identifier(range(11, 19))
    lost = 0
    for t in np.arange(0.0, 26.0, 0.1):
        answer = identifier.update(ships.seen(t, who, 2.0, -0.8), camera(), ships.reports(t))
        lost += np.count_nonzero(answer.system_id != 11 + who) if t > 10.0 else 0
    assert lost == 0


@pytest.mark.slow
def test_no_ship_of_another_place_is_surely_named():
    who, share = np.array([1, 4, 6]), []
    for seed in range(6):
        got, sure, _ = named(Ships(seed), Ships(100 + seed), who, 60.0, yaw_deg=0.0)
        assert not np.any((got > 0) & (sure > 0.9))
        share.append(np.mean(got > 0))
    assert np.median(share) < 0.1


def test_a_statement_counts_near_the_horizon():
    ships, who = Ships(3), np.array([1, 4])
    *_, identifier = named(ships, ships, who, 10.0)
    identifier.state(1, 18)
    answer = identifier.update(ships.seen(10.0, who, 2.0, 0.0), camera(), ships.reports(10.0))
    assert answer.system_id[0] == 18


def test_the_sum_over_assignments_is_exact_without_loops():
    score = np.random.default_rng(2).normal(0.0, 2.0, (4, 3, 1))
    p, total = loopy_marginals(score)
    # no more than one track has the vehicle
    assert total == pytest.approx(np.log1p(np.exp(score).sum(axis=(1, 2))))
    assert p[2] == pytest.approx(exact_marginals(score[2]))
