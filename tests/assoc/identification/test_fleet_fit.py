"""Film and telemetry that do not belong together: no names, whatever single vehicles look like."""

from dataclasses import replace
from itertools import combinations, permutations
from types import SimpleNamespace

import numpy as np
import pytest

from assoc.geometry.ground import OFFSET, THETA
from assoc.hypotheses.pose import PosePrior
from assoc.identification import fleet_fit
from assoc.identification.fleet_fit import FitEvidence, FleetFit, log_assignments
from assoc.identification.identifier import Identifier
from assoc.records import VehicleReports
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14)


def films(identifier, film, fleet, start, stop):
    """Frames of one fleet beside the reports of another; (answers, fit probabilities)."""
    rng, answers, fits = np.random.default_rng(1), [], []
    for k in range(round(start * 10), round(stop * 10)):
        t = k / 10
        reports = fleet.reports(t - 0.1, t, rng) if fleet else VehicleReports.empty()
        tracks = np.arange(1, film.n + len(film.strangers) + 1)
        answers.append(identifier.update(film.observation(t, camera(), tracks, rng), camera(), reports))
        fits.append(identifier.fit_probability)
    return answers, fits


@pytest.mark.parametrize("tracks", [0, 1, 3, 5])
def test_all_assignments_are_summed(tracks):
    odds = np.array([0.3, 2.0, -1.5])
    total = sum(
        float(np.prod(np.exp(odds[list(vehicles)])))
        for k in range(min(tracks, 3) + 1)
        for vehicles in combinations(range(3), k)
        for _ in permutations(range(tracks), k)
    )
    assert log_assignments(odds, tracks) == pytest.approx(np.log(total))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(4))
def test_the_film_of_another_fleet_is_named_nowhere(seed):
    film = Fleet(seed=seed + 10, n=7, spacing_m=7.0, strangers=((4.0, 9.0),))
    film.start = film.start @ np.array([[0.6, 0.8], [-0.8, 0.6]]) + (3.0, -2.0)
    answers, fits = films(Identifier(IDS), film, Fleet(seed=seed), 0.0, 5.0)
    assert not any(answer.system_id.any() for answer in answers)
    assert max(fits[1:]) < 0.5
    assert not any(answer.conflict for answer in answers), "nobody is accused for it"


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(4))
def test_the_film_of_the_fleet_itself_is_named_in_its_first_frames(seed):
    fleet = Fleet(seed=seed)
    answers, fits = films(Identifier(IDS), fleet, fleet, 0.0, 3.0)
    assert all(answer.system_id.tolist() == list(IDS) for answer in answers[5:])
    assert min(fits[5:]) > 0.99


@pytest.mark.slow
def test_names_go_when_the_film_becomes_another_and_come_back_with_the_right_one():
    fleet, other, identifier = Fleet(seed=1), Fleet(seed=8, n=6, spacing_m=5.0), Identifier(IDS)
    other.start = other.start[:, ::-1] + (2.0, 5.0)
    films(identifier, fleet, fleet, 0.0, 8.0)
    answers, fits = films(identifier, other, fleet, 8.0, 25.0)
    assert fits[-1] < 0.01 and not answers[-1].system_id.any()
    answers, fits = films(identifier, fleet, fleet, 25.0, 40.0)
    assert fits[-1] > 0.99 and answers[-1].system_id.tolist() == list(IDS)


@pytest.mark.slow
def test_without_reports_nothing_speaks_against_the_film():
    fleet, identifier = Fleet(seed=2), Identifier(IDS)
    films(identifier, fleet, fleet, 0.0, 6.0)
    _, fits = films(identifier, fleet, None, 6.0, 40.0)
    assert min(fits) > 0.99


def test_what_is_stated_stays_while_nothing_fits():
    fit = FleetFit()
    fit.add_evidence(0.0, -20.0, -20.0)
    p = np.array([[0.9, 0.05, 0.05], [0.1, 0.8, 0.1]])
    limited = fit.limited(p, np.array([True, False]))
    assert limited[0].tolist() == pytest.approx(p[0].tolist())
    assert limited[1, 2] > 0.99 and limited.sum(axis=1).tolist() == pytest.approx([1.0, 1.0])


def test_evidence_against_a_fit_counts_only_as_far_as_chance_does_as_well():
    def after(chance):
        fit = FleetFit()
        fit.add_evidence(0.0, 30.0, 0.0)
        for k in range(40):
            fit.add_evidence(0.25 * k, -20.0, chance)
        return fit.probability

    assert after(-20.0) < 0.01 and after(-50.0) > 0.99


def test_a_known_camera_that_fits_no_longer_is_doubted_within_seconds():
    fit = FleetFit()
    fit.add_evidence(0.0, 60.0, None)
    for k in range(1, 11):
        fit.add_evidence(0.25 * k, -5.0, None)
    assert fit.probability < 0.5


@pytest.mark.slow
def test_a_camera_without_a_gimbal_is_doubted_later_than_one_that_is_steady():
    def named_s(**view):
        """How long the names stay on the other film, seconds."""
        fleet, other, identifier = Fleet(seed=1), Fleet(seed=8, n=6, spacing_m=5.0), Identifier(IDS)
        other.start = other.start[:, ::-1] + (2.0, 5.0)
        looks, rng, since = replace(camera(), **view), np.random.default_rng(1), 0
        for k in range(200):
            film, t = (fleet if k < 60 else other), k / 10
            seen = film.observation(t, looks, np.arange(1, film.n + 1), rng)
            identifier.update(seen, looks, fleet.reports(t - 0.1, t, rng))
            since += k >= 60 and identifier.fit_probability > 0.5
        return since / 10

    assert named_s(stabilized=True) + 1.0 < named_s(stabilized=False) < 14.0


def test_evidence_that_comes_to_little_is_forgotten_in_seconds():
    fit = FleetFit()
    fit.add_evidence(0.0, 60.0, None)
    for k in range(1, 100):
        fit.add_evidence(0.25 * k, 2.0, None)
    assert fit.probability < 0.9


def test_what_fitted_without_a_gross_error_is_not_saved_by_one_that_comes_in_flight(monkeypatch):
    monkeypatch.setattr(fleet_fit, "evidence_of", lambda context, best: best.evidence)
    monkeypatch.setattr(fleet_fit, "decoy_evidence", lambda context, number: FitEvidence(0.0, 0.0))
    late = np.where(np.arange(THETA) == OFFSET, 5.0, 0.0)
    prior = PosePrior(std=np.full(THETA, 0.1), others=(PosePrior(std=np.full(THETA, 0.1), mean=late, log_share=-7.0),))
    blocks = SimpleNamespace(count=np.ones((20, 1, 1)))

    def fits(*parts):
        """Whether they fit after ten seconds of each part: its θ, evidence, vehicles' chance to be in view."""
        fit = FleetFit()
        for k in range(40 * len(parts)):
            theta, course, view = parts[k // 40]
            best = SimpleNamespace(
                theta=theta, blocks=blocks, vehicle=np.zeros(1, np.int64), evidence=FitEvidence(course, 0.0)
            )
            context = SimpleNamespace(prior=prior, sway=None, block_s=1.0, view=np.full(5, view))
            fit.update(0.25 * k, context, best, steady=True)
        return fit.fits

    assert not fits((np.zeros(THETA), 30.0, 1.0), (late, 20.0, 1.0))
    assert not fits((np.zeros(THETA), 30.0, 1.0), (late, 20.0, 0.0)), "the fleet may not hide"
    assert fits((np.zeros(THETA), 30.0, 1.0), (late, 60.0, 1.0))
    assert fits((late, 60.0, 1.0), (late, 20.0, 1.0)), "a gross error pays once"


def test_what_was_paid_for_strangers_is_not_asked_for_again(monkeypatch):
    monkeypatch.setattr(fleet_fit, "evidence_of", lambda context, best: best.evidence)
    # twenty seconds of a pair: 14 nats
    best = SimpleNamespace(
        theta=np.zeros(THETA), blocks=SimpleNamespace(count=np.ones((20, 1, 1))), vehicle=np.zeros(1, np.int64)
    )
    context = SimpleNamespace(prior=PosePrior(std=np.full(THETA, 0.1)), sway=None, block_s=1.0, view=np.ones(5))

    def fits(course, strangers, chance):
        monkeypatch.setattr(fleet_fit, "decoy_evidence", lambda context, number: FitEvidence(chance, 0.0))
        best.evidence = FitEvidence(course, 0.0, strangers)
        fit = FleetFit()
        fit.update(0.0, context, best, steady=True)
        return fit.fits

    assert not fits(14.0, 0.0, -20.0) and fits(18.0, 0.0, -20.0)
    assert fits(14.0, 10.0, -20.0)
    assert not fits(14.0, 10.0, -1.0), "chance has not paid for them"
    assert not fits(2.0, 30.0, -40.0), "nothing is lent"


@pytest.mark.slow
def test_video_that_is_dated_late_by_seconds_fits_once_the_vehicles_have_moved():
    fleet, identifier, rng = Fleet(seed=3), Identifier(IDS), np.random.default_rng(2)
    for k in range(20, 220):
        t = k / 10
        seen = fleet.observation(t - 3.0, camera(), [1, 2, 3, 4], rng)
        answer = identifier.update(replace(seen, t_us=seen.t_us + 3_000_000), camera(), fleet.reports(t - 0.1, t, rng))
    assert answer.system_id.tolist() == list(IDS) and identifier.fit_probability > 0.99
    assert abs(identifier.pose_correction[7] - 3.0) < 0.3


@pytest.mark.slow_but_first
@pytest.mark.parametrize("turned_deg", [90.0, 180.0, -90.0])
def test_a_camera_mounted_turned_is_found_in_the_first_frames(turned_deg):
    fleet, identifier, rng = Fleet(seed=3, n=4), Identifier(IDS), np.random.default_rng(2)
    told = camera(yaw=np.deg2rad(turned_deg))
    for k in range(40):
        t = k / 10
        seen = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        answer = identifier.update(seen, told, fleet.reports(t - 0.1, t, rng))
        assert set(zip(answer.system_id.tolist(), IDS, strict=True)) <= {(0, 11), (0, 12), (0, 13), (0, 14)} | {
            (vehicle, vehicle) for vehicle in IDS
        }
        assert k < 19 or answer.system_id.tolist() == list(IDS)
    assert answer.confidence.min() > 0.88


def test_no_name_is_sure_before_the_vehicles_have_driven_like_the_tracks():
    fleet, identifier = Fleet(seed=3), Identifier(IDS)
    answers, _ = films(identifier, fleet, fleet, 0.0, 8.0)
    first = [answer for answer in answers[3:10] if answer.system_id.all()]
    assert first and max(answer.confidence.max() for answer in first) < 0.9
    assert answers[-1].system_id.tolist() == list(IDS) and answers[-1].confidence.min() > 0.97


def test_what_the_operator_states_is_sure_at_once():
    fit = FleetFit()
    p = np.array([[0.99, 0.0, 0.01], [0.0, 0.99, 0.01]])
    shown = fit.shown(p, np.array([True, False]))
    np.testing.assert_allclose(shown[0], p[0])
    assert shown[1, 1] < 0.9 and shown[1].sum() == pytest.approx(1.0)
