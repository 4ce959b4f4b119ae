"""Receivers whose errors wander too fast for their course: vehicles are then named by their places, never surely."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from assoc.identification.doubts import AnswerDoubt
from assoc.identification.identifier import Identifier
from tests.support.assoc_scene import T0_US, Fleet, play

IDS = (11, 12, 13, 14, 15, 16, 17)


class Wandering(Fleet):
    """Each axis of each report errs by a sine of its own, 1.4 m 1σ, of 8 to 13 s."""

    def reports(self, start, stop, rng):
        own = np.random.default_rng(self.seed)
        period_s, phase = own.uniform(8.0, 13.0, (self.n, 2)), own.uniform(0.0, 2.0 * np.pi, (self.n, 2))
        true = super().reports(start, stop, rng)
        t = (true.t_us - T0_US)[:, None] * 1e-6
        error = 2.0 * np.sin(2.0 * np.pi * t / period_s[true.vehicle] + phase[true.vehicle])
        return replace(true, p_enu=true.p_enu + np.pad(error, ((0, 0), (0, 1))))


@dataclass
class Drifting(Fleet):
    """Every report is of another vehicle, which drives likewise in its place of the formation and drifts from it."""

    drift_mps: float = 1.6

    def reports(self, start, stop, rng):
        own = np.random.default_rng(self.seed)
        drift = own.uniform(-self.drift_mps, self.drift_mps, (self.n, 2))
        true = super().reports(start, stop, rng)
        t = (true.t_us - T0_US)[:, None] * 1e-6
        return replace(true, p_enu=true.p_enu + np.pad(drift[true.vehicle] * t, ((0, 0), (0, 1))))


def named(answers, start_s):
    """Shares of the boxes from a time on that have their own name and another's, and the largest confidence."""
    late = [answer for t, answer in answers if t >= start_s]
    names, ids = np.array([answer.system_id for answer in late]), np.array(IDS)
    sure = max(float(np.max(answer.confidence[answer.system_id > 0], initial=0.0)) for answer in late)
    return (names == ids).mean(), ((names != ids) & (names > 0)).mean(), sure


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_errors_that_go_round_in_ten_seconds_cost_no_names(seed):
    identifier = Identifier(IDS)
    answers = play(identifier, Wandering(n=7, seed=seed, white_m=0.05, bias_m=0.0, spacing_m=7.0), 20.0)
    right, wrong, sure = named(answers, 11.0)
    assert right > 0.95
    assert wrong == 0.0
    assert sure < 0.9
    assert set(answers[-1][1].doubt.tolist()) == {AnswerDoubt.WANDERING}
    assert identifier.fit_probability > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_formation_that_drifts_off_is_not_named_by_its_places(seed):
    identifier = Identifier(IDS)
    answers = play(identifier, Drifting(n=7, seed=seed, white_m=0.05, bias_m=1.5, spacing_m=7.0), 14.0)
    assert named(answers, 11.0)[:2] == (0.0, 0.0)
    assert identifier.fit_probability < 0.1


@pytest.mark.slow
def test_a_formation_that_drifts_off_slowly_is_never_named_by_its_places():
    identifier = Identifier(IDS)
    answers = play(identifier, Drifting(n=7, seed=2, white_m=0.05, bias_m=1.5, spacing_m=7.0, drift_mps=0.8), 14.0)
    assert AnswerDoubt.WANDERING not in {doubt for _, answer in answers for doubt in answer.doubt.tolist()}
