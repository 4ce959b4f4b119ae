"""The identifier as a whole, on small worlds of its own."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.errors import ShapeError
from assoc.identification.estimate import Estimator
from assoc.identification.identifier import Identifier
from assoc.params import IdentifierParams
from assoc.records import Observation, VehicleReports
from tests.support.assoc_scene import T0_US, Fleet, camera, play

IDS = (11, 12, 13, 14)


def said(answers, start=0.0):
    """(frames, m) system ids from a time on."""
    return np.array([a.system_id for t, a in answers if t >= start])


def test_everybody_is_named_from_the_first_frame_on():
    answers = play(Identifier(IDS), Fleet(), 4.0)
    assert (said(answers) == IDS).mean() > 0.97
    last = answers[-1][1]
    assert np.all(last.confidence > 0.95)
    assert np.all(last.residual_m < 3.0)
    assert np.all((last.position_age_s >= 0) & (last.position_age_s < 0.5))
    for mass in (last.projection, last.topology, last.fused):
        assert np.all((mass >= 0) & (mass <= 1))
    assert last.conflict == ()


@pytest.mark.parametrize("told", [True, False])
def test_a_vehicle_is_not_missed_where_nobody_looked(told):
    fleet, identifier, rng = Fleet(rate_hz=20.0), Identifier(IDS), np.random.default_rng(1)
    view = replace(camera(), half_view=(0.8, 0.45))
    for k in range(60):
        seen = fleet.observation(k / 10, view, [1, 2, 3, 4], rng)
        # every second frame two of the four are looked at
        gap_s = np.where(np.arange(4) // 2 == k % 2, 0.1, 0.0) * (k > 3)
        unlooked_s = dict(zip(IDS, gap_s.tolist(), strict=True)) if told else {}
        reports = fleet.reports((k - 1) / 10, k / 10, rng)
        answer = identifier.update(replace(seen, gap_s=gap_s), view, reports, unlooked_s=unlooked_s)
    assert answer.system_id.tolist() == list(IDS)
    assert (identifier._estimator._found.share > 0.95) == told


def test_names_follow_the_telemetry_not_the_order():
    answers = play(Identifier(IDS), Fleet(), 3.0, vehicles=[2, 0, 3, 1])
    assert np.all(said(answers, 1.0) == [13, 11, 14, 12])


def test_strangers_stay_unnamed():
    fleet = Fleet(strangers=((-8.0, -12.0), (3.0, 13.0)))
    answers = play(Identifier(IDS), fleet, 6.0)
    assert (said(answers)[:, 4:] == 0).mean() > 0.98
    last = answers[-1][1]
    assert np.all(last.confidence[4:] > 0.9)
    assert np.all(np.isnan(last.residual_m[4:]) & np.isnan(last.fused[4:]))


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "told",
    [
        camera(yaw=np.deg2rad(14.0)),  # compass
        camera(p=(1.5, -1.5, 41.0)),  # position and height
        camera(yaw=np.deg2rad(-10.0), p=(-1.0, 1.5, 39.0)),
    ],
)
def test_wrong_pose_is_corrected(told):
    identifier = Identifier(IDS)
    answers = play(identifier, Fleet(), 5.0, told=told, true=camera())
    assert np.all(said(answers, 2.0) == IDS)


def from_afar(down_deg, yaw_deg):
    """A camera 450 m south of the fleet and 47 m up."""
    down, yaw = np.deg2rad([down_deg, yaw_deg])
    forward = np.array([np.sin(yaw) * np.cos(down), np.cos(yaw) * np.cos(down), -np.sin(down)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    R = np.stack([right, np.cross(forward, right), forward], axis=1)
    return replace(camera(p=(0.0, -450.0, 47.0)), R_enu_cam=R)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("down_deg", "yaw_deg"), [(6.8, 3.0), (5.0, -4.0)])
def test_a_camera_that_looks_far_may_be_tilted(down_deg, yaw_deg):
    answers = play(Identifier(IDS), Fleet(), 5.0, told=from_afar(down_deg, yaw_deg), true=from_afar(6.0, 0.0))
    assert np.all(said(answers, 3.0) == IDS)


def test_compass_error_is_found():
    identifier = Identifier(IDS)
    play(identifier, Fleet(bias_m=0.1), 8.0, told=camera(yaw=0.2), true=camera())
    assert identifier.pose_correction[0] == pytest.approx(-0.2, abs=0.03)


def test_no_attitude_at_all():
    answers = play(
        Identifier(IDS), Fleet(), 8.0, told=camera(attitude_known=False), true=camera(yaw=2.5, attitude_known=False)
    )
    assert np.all(said(answers, 5.0) == IDS)


def test_without_headings():
    answers = play(Identifier(IDS), Fleet(headings=False), 4.0)
    assert np.all(said(answers, 1.5) == IDS)


@pytest.mark.slow
def test_swapped_tracks_are_found_out():
    def ids(t):
        return [1, 2, 3, 4] if t < 6.0 else [2, 1, 3, 4]

    answers = play(Identifier(IDS), Fleet(), 9.0, ids=ids)
    assert np.all(said(answers, 8.0) == IDS)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_tracks_that_come_out_of_the_dark_exchanged_are_not_trusted(seed):
    identifier, fleet = Identifier(IDS), Fleet(spacing_m=5.0, seed=seed)
    play(identifier, fleet, 6.0)
    rng = np.random.default_rng(5)
    identifier.add_reports(fleet.reports(5.9, 7.5, rng))
    for k in range(75, 90):
        t = k / 10
        s = fleet.observation(t, camera(), [2, 1, 4, 3], rng)
        answer = identifier.update(s, camera(), fleet.reports(t - 0.1, t, rng) if k > 75 else None)
        wrong = (answer.system_id != IDS) & (answer.system_id > 0)
        assert not np.any(wrong & (answer.confidence > 0.9)), t
    assert answer.system_id.tolist() == list(IDS)


@pytest.mark.slow
def test_where_looks_are_rare_and_reports_poor_a_name_is_kept_across_holes():
    identifier, fleet = Identifier(IDS), Fleet(spacing_m=6.0, white_m=3.0, bias_m=0.1)
    play(identifier, fleet, 8.0)
    rng, heard, named = np.random.default_rng(5), 7.9, []
    for t in np.cumsum(np.tile([0.1, 0.1, 0.1, 0.7], 8)) + 8.0:
        s = fleet.observation(float(t), camera(), [1, 2, 3, 4], rng)
        named.append(identifier.update(s, camera(), fleet.reports(heard, float(t), rng)).system_id)
        heard = float(t)
    assert np.mean(np.array(named) == IDS) > 0.95


def test_new_track_of_a_known_vehicle_is_named_within_a_quarter_second():
    def ids(t):
        return [1, 2, 3, 4] if t < 5.0 else [9, 2, 3, 4]

    answers = play(Identifier(IDS), Fleet(bias_m=1.0), 6.0, ids=ids)
    assert np.all(said(answers, 5.25) == IDS)


def test_a_predicted_track_gives_its_name_to_the_new_one():
    identifier, fleet = Identifier(IDS), Fleet()
    play(identifier, fleet, 4.0)
    rng = np.random.default_rng(5)
    heard = 3.9
    for k in range(10):
        t = 4.0 + k / 10
        s = fleet.observation(t, camera(), [9, 2, 3, 4], rng)
        # track 1 coasts beside its successor
        s = Observation(
            t_us=s.t_us,
            track_id=np.append(s.track_id, 1),
            ray_cam=np.vstack([s.ray_cam, s.ray_cam[:1] + 0.02]),
            front_cam=np.vstack([s.front_cam, s.front_cam[:1]]),
            gap_s=np.append(s.gap_s, 0.1 + k / 10),
            score=np.append(s.score, 0.5),
        )
        answer = identifier.update(s, camera(), fleet.reports(heard, t, rng))
        heard = t
    assert answer.system_id.tolist() == [*IDS, 0]


@pytest.mark.slow_but_first
@pytest.mark.parametrize("t", [0.8, 1.5, 4.0])
@pytest.mark.parametrize("away_m", [3.0, 4.0])
def test_a_stranger_does_not_take_the_name_of_a_box_missed_for_a_moment(t, away_m):
    identifier, fleet = Identifier(IDS), Fleet(bias_m=1.0)
    play(identifier, fleet, t)
    rng = np.random.default_rng(5)
    s = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
    aside = np.array([-away_m / 40.0, 0.0, 0.0])
    s = Observation(
        t_us=s.t_us,
        track_id=np.append(s.track_id, 9),
        ray_cam=np.vstack([s.ray_cam, s.ray_cam[:1] + aside]),
        front_cam=np.vstack([s.front_cam, s.front_cam[:1] + aside]),
        gap_s=np.array([0.1, 0, 0, 0, 0]),
        score=np.append(s.score, 0.9),
    )
    answer = identifier.update(s, camera(), fleet.reports(t - 0.1, t, rng))
    assert answer.system_id.tolist() == [*IDS, 0]


@pytest.mark.slow
def test_a_stranger_at_the_side_does_not_become_a_vehicle_that_is_hidden():
    identifier, fleet = Identifier(IDS), Fleet(bias_m=1.0)
    rng, heard = np.random.default_rng(5), -0.1
    aside = np.array([-7.0 / 40.0, 0.0, 0.0])
    for k in range(83):
        t = k / 10
        s = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        hidden_s = max(0.0, t - 6.9)
        s = Observation(
            t_us=s.t_us,
            track_id=np.append(s.track_id, 9),
            ray_cam=np.vstack([s.ray_cam, s.ray_cam[:1] + aside]),
            front_cam=np.vstack([s.front_cam, s.front_cam[:1] + aside]),
            gap_s=np.array([hidden_s, 0, 0, 0, 0]),
            score=np.append(s.score, 0.9),
        )
        answer = identifier.update(s, camera(), fleet.reports(heard, t, rng))
        heard = t
        assert t < 1.0 or answer.system_id[4] == 0, t


@pytest.mark.slow_but_first
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("gone_s", [1.0, 2.0])
def test_a_follower_does_not_get_the_name_of_a_vehicle_that_left_the_image(gone_s, seed):
    identifier, fleet = Identifier(IDS), Fleet(bias_m=1.0, seed=seed)
    rng, heard = np.random.default_rng(5), -0.1
    aside = np.array([-6.0 / 40.0, 0.0, 0.0])
    for k in range(round(10 * gone_s) + 20):
        t = k / 10
        s = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        left = slice(0 if t < gone_s else 1, None)
        s = Observation(
            t_us=s.t_us,
            track_id=np.append(s.track_id, 9)[left],
            ray_cam=np.vstack([s.ray_cam, s.ray_cam[:1] + aside])[left],
            front_cam=np.vstack([s.front_cam, s.front_cam[:1] + aside])[left],
            gap_s=np.zeros(5)[left],
            score=np.append(s.score, 0.9)[left],
        )
        answer = identifier.update(s, camera(), fleet.reports(heard, t, rng))
        heard = t
        assert answer.system_id[-1] == 0 or answer.confidence[-1] < 0.9, t
    assert answer.system_id[:-1].tolist() == list(IDS[1:])


@pytest.mark.slow
def test_silence_keeps_the_name_of_an_unbroken_track():
    identifier, fleet = Identifier(IDS), Fleet()
    rng = np.random.default_rng(1)
    confidence = []
    for k in range(300):
        t = k / 10
        r = fleet.reports(t - 0.1, t, rng) if t < 5.0 else VehicleReports.empty()
        answer = identifier.update(fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera(), r)
        confidence.append(answer.confidence.min())
        assert t < 2.0 or answer.system_id.tolist() == list(IDS)
    assert confidence[-1] <= max(confidence[:100]) + 1e-3


def test_a_copied_vehicle_is_not_named_but_listed():
    identifier, fleet = Identifier((*IDS, 15)), Fleet()
    rng = np.random.default_rng(1)
    answer = None
    for k in range(80):
        t = k / 10
        r = fleet.reports(t - 0.1, t, rng)
        mine = np.flatnonzero(r.vehicle == 1)
        doubled = np.concatenate([np.arange(len(r.t_us)), mine])
        vehicle = r.vehicle[doubled]
        vehicle[len(r.t_us) :] = 4
        r = VehicleReports(
            t_us=r.t_us[doubled],
            vehicle=vehicle,
            p_enu=r.p_enu[doubled] + 0.05 * (vehicle == 4)[:, None],
            v_enu=r.v_enu[doubled],
            heading=r.heading[doubled],
            std_m=r.std_m[doubled],
        )
        answer = identifier.update(fleet.observation(t, camera(), [1, 2, 3, 4], rng), camera(), r)
    assert answer.conflict == (12, 15)
    assert answer.system_id.tolist() == [11, 0, 13, 14]


def test_permuting_tracks_permutes_the_answer():
    fleet, order = Fleet(), np.array([2, 0, 3, 1])
    first, second = Identifier(IDS), Identifier(IDS)
    rng = np.random.default_rng(3)
    for k in range(25):
        t = k / 10
        r = fleet.reports(t - 0.1, t, rng)
        s = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        turned = Observation(
            t_us=s.t_us,
            track_id=s.track_id[order],
            ray_cam=s.ray_cam[order],
            front_cam=s.front_cam[order],
            gap_s=s.gap_s,
            score=s.score,
        )
        a, b = first.update(s, camera(), r), second.update(turned, camera(), r)
        np.testing.assert_array_equal(a.system_id[order], b.system_id)
        np.testing.assert_allclose(a.confidence[order], b.confidence, atol=1e-5)


@pytest.mark.slow
def test_permuting_vehicles_permutes_the_answer():
    order = [1, 3, 0, 2]
    straight = play(Identifier(IDS), Fleet(), 2.5)
    turned = play(Identifier([IDS[order.index(j)] for j in range(4)]), Fleet(), 2.5, vehicles=order)
    for (_, a), (_, b) in zip(straight, turned, strict=True):
        np.testing.assert_array_equal(a.system_id, b.system_id)
        np.testing.assert_allclose(a.confidence, b.confidence, atol=1e-5)


def test_equal_input_gives_equal_output():
    a, b = (play(Identifier(IDS), Fleet(seed=4), 3.0) for _ in range(2))
    for (_, x), (_, y) in zip(a, b, strict=True):
        np.testing.assert_array_equal(x.confidence, y.confidence)


@pytest.mark.slow
def test_time_running_backwards_starts_anew():
    identifier, fleet = Identifier(IDS), Fleet()
    play(identifier, fleet, 2.0)
    assert np.all(said(play(identifier, fleet, 2.0), 1.0) == IDS)


@pytest.mark.parametrize(("vehicles", "tracks"), [(0, 0), (0, 2), (2, 0), (1, 1), (1, 3), (3, 1)])
def test_few_of_everything(vehicles, tracks):
    fleet = Fleet(n=max(vehicles, tracks, 1))
    identifier = Identifier(range(21, 21 + vehicles))
    rng = np.random.default_rng(0)
    for k in range(12):
        t = k / 10
        s = fleet.observation(t, camera(), np.arange(fleet.n) + 1, rng)
        s = Observation(
            t_us=s.t_us,
            track_id=s.track_id[:tracks],
            ray_cam=s.ray_cam[:tracks],
            front_cam=s.front_cam[:tracks],
            gap_s=s.gap_s[:tracks],
            score=s.score[:tracks],
        )
        r = fleet.reports(t - 0.1, t, rng)
        mine = r.vehicle < vehicles
        r = VehicleReports(
            t_us=r.t_us[mine],
            vehicle=r.vehicle[mine],
            p_enu=r.p_enu[mine],
            v_enu=r.v_enu[mine],
            heading=r.heading[mine],
            std_m=r.std_m[mine],
        )
        answer = identifier.update(s, camera(), r)
        assert len(answer.system_id) == tracks
        assert np.all((answer.confidence >= 0) & (answer.confidence <= 1))
    named = answer.system_id[answer.system_id > 0]
    assert len(set(named.tolist())) == len(named)


def test_nonsense_does_not_spread():
    identifier, fleet = Identifier(IDS), Fleet()
    rng = np.random.default_rng(0)
    for k in range(60):
        t = k / 10
        s, r = fleet.observation(t, camera(), [1, 2, 3, 4], rng), fleet.reports(t - 0.1, t, rng)
        bad = r.p_enu.copy()
        bad[k % 7 :: 7] = np.nan
        ray = s.ray_cam.copy()
        ray[k % 4] = np.nan if k % 5 == 0 else ray[k % 4]
        view = camera(p=(np.nan, 0.0, 40.0)) if k % 9 == 0 else camera()
        s = Observation(
            t_us=s.t_us, track_id=s.track_id, ray_cam=ray, front_cam=s.front_cam, gap_s=s.gap_s, score=s.score
        )
        r = VehicleReports(t_us=r.t_us, vehicle=r.vehicle, p_enu=bad, v_enu=r.v_enu, heading=r.heading, std_m=r.std_m)
        answer = identifier.update(s, view, r)
        assert np.isfinite(answer.confidence).all()
    assert answer.system_id.tolist() == list(IDS)


def test_threshold_one_names_nobody():
    answers = play(Identifier(IDS, IdentifierParams(threshold=1.1)), Fleet(), 1.0)
    assert np.all(said(answers) == 0)


def test_lost_tracks_are_stitched_by_telemetry():
    identifier, fleet = Identifier(IDS), Fleet()
    play(identifier, fleet, 4.0)
    s = fleet.observation(4.0, camera(), [1, 2, 3, 4], np.random.default_rng(0))
    pairs = identifier.stitch(T0_US + 4_000_000, np.array([3, 1]), s.ray_cam[[0, 2]], camera())
    assert sorted(pairs.tolist()) == [[0, 1], [1, 0]]
    far = s.ray_cam[[0]] + np.array([0.3, 0.3, 0.0])
    assert identifier.stitch(T0_US + 4_000_000, np.array([1]), far, camera()).shape == (0, 2)


def test_shapes_are_checked():
    with pytest.raises(ShapeError, match="ray_cam"):
        Observation(
            t_us=0, track_id=np.array([1]), ray_cam=np.zeros((2, 3)), front_cam=np.zeros((1, 3)), gap_s=np.zeros(1),
            score=np.zeros(1),
        )  # fmt: skip


@pytest.mark.slow
def test_noise_of_the_reports_is_no_reason_to_search_again_while_locked(monkeypatch):
    times, update = [], Estimator.update

    def noted(estimator, t, camera):
        times.append(t)
        return update(estimator, t, camera)

    monkeypatch.setattr(Estimator, "update", noted)
    identifier = Identifier(IDS)
    play(identifier, Fleet(white_m=3.0), 13.0)
    assert identifier.locked and np.diff([t for t in times if t > 8.0]).min() > 0.7
