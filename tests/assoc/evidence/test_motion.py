"""What the vehicles' reports say of themselves, without any image."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.evidence.motion import WHITE_STD_M, ReportLog
from assoc.records import VehicleReports


def drive(std, seconds=20.0, seed=0, n=3, hz=5.0):
    """Reports of n vehicles on gentle curves: times and records."""
    rng = np.random.default_rng(seed)
    t = np.repeat(np.arange(0.0, seconds, 1.0 / hz), n)
    vehicle = np.tile(np.arange(n), len(t) // n)
    p = np.stack([4.0 * t, 10.0 * np.sin(0.3 * t + vehicle) + 8.0 * vehicle, 0 * t], axis=1)
    v = np.stack([4.0 + 0 * t, 3.0 * np.cos(0.3 * t + vehicle), 0 * t], axis=1)
    noise = rng.normal(0, std, p.shape) * (1, 1, 0)
    return t, VehicleReports(
        t_us=(t * 1e6).astype(np.int64), vehicle=vehicle, p_enu=p + noise, v_enu=v, heading=0 * t, std_m=0 * t
    )


def pick(t, r, rows):
    return t[rows], VehicleReports(
        t_us=r.t_us[rows],
        vehicle=r.vehicle[rows],
        p_enu=r.p_enu[rows],
        v_enu=r.v_enu[rows],
        heading=r.heading[rows],
        std_m=r.std_m[rows],
    )


@pytest.mark.parametrize("std", [0.05, 0.3, 0.8, 2.0, 4.5])
def test_white_noise_is_recognised(std):
    log = ReportLog(3, 20.0)
    log.add(*drive(std))
    k = int(np.argmin(np.abs(WHITE_STD_M - std)))
    assert abs(log.white_index - k) <= 1


def test_a_jump_is_noticed_and_normal_driving_is_not():
    t, r = drive(0.3)
    moved = r.p_enu + np.where((t > 10.05) & (r.vehicle == 1), 15.0, 0.0)[:, None] * (1.0, 0.0, 0.0)
    log = ReportLog(3, 20.0)
    log.add(t, replace(r, p_enu=moved))
    s = log.samples(0.0, 20.0)
    jumps = np.flatnonzero(s.jump_var > 0)
    assert set(s.vehicle[jumps].tolist()) == {1}
    assert s.t[jumps][0] == pytest.approx(10.2, abs=0.01)
    assert np.sqrt(s.jump_var[jumps][0]) == pytest.approx(15.0, abs=2.0)


def test_frozen_positions_are_no_news():
    t, r = drive(0.3)
    held = r.p_enu.copy()
    for j in range(3):
        late = (r.vehicle == j) & (t > 10.0)
        held[late] = held[np.flatnonzero((r.vehicle == j) & (t <= 10.0))[-1]]
    log = ReportLog(3, 20.0)
    log.add(t, replace(r, p_enu=held))
    assert log.frozen.all()
    assert log.samples(10.5, 20.0).t.size == 0
    assert np.all(log.extrapolated(19.8)[1] > 9.0)


def test_order_within_a_batch_does_not_matter_and_old_reports_are_passed_over():
    t, r = drive(0.5)
    one, two = ReportLog(3, 20.0), ReportLog(3, 20.0)
    one.add(t, r)
    two.add(*pick(t, r, np.random.default_rng(1).permutation(len(t))))
    a, b = one.samples(0.0, 20.0), two.samples(0.0, 20.0)
    np.testing.assert_array_equal(a.p, b.p)
    np.testing.assert_allclose(a.log_null, b.log_null)
    before = len(a.t)
    one.add(*pick(t, r, np.arange(10)))
    assert len(one.samples(0.0, 20.0).t) == before


def test_extrapolation_moves_on_with_the_velocity():
    t, r = drive(0.0)
    log = ReportLog(4, 20.0)
    log.add(t, r)
    p, age = log.extrapolated(20.8)
    assert p[0, 0] == pytest.approx(4.0 * 20.8, abs=0.01)
    assert age[0] == pytest.approx(1.0)
    assert np.isnan(p[3]).all() and np.isinf(age[3])


@pytest.mark.parametrize("ago_s", [0.1, 2.0, 6.0])
def test_where_a_vehicle_was_lies_between_its_reports(ago_s):
    t, r = drive(0.0)
    log = ReportLog(4, 20.0)
    log.add(t, r)
    then = float(t.max()) - ago_s
    p, age = log.extrapolated(then)
    there = np.stack([4.0 * then + np.zeros(3), 10.0 * np.sin(0.3 * then + np.arange(3)) + 8.0 * np.arange(3)], axis=1)
    np.testing.assert_allclose(p[:3], there, atol=0.05)
    np.testing.assert_allclose(age[:3], -ago_s)
    assert np.isnan(p[3]).all()


def test_reports_in_small_batches_are_the_same_reports():
    t, r = drive(0.5)
    whole, parts = ReportLog(3, 20.0), ReportLog(3, 20.0)
    whole.add(t, r)
    for start in range(0, len(t), 3):
        parts.add(*pick(t, r, slice(start, start + 3)))
    a, b = whole.samples(0.0, 30.0), parts.samples(0.0, 30.0)
    for name in ("t", "vehicle", "p", "heading", "log_null", "jump_var"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert whole.white_std_m == parts.white_std_m


@pytest.mark.slow
def test_reports_that_nobody_asks_for_do_not_pile_up():
    t, r = drive(0.3, seconds=200.0)
    log = ReportLog(3, 20.0)
    for start in range(0, len(t), 3):
        log.add(*pick(t, r, slice(start, start + 3)))
    assert sum(len(part.t) for part in log._closed) < 3 * (1.2 * 20.0 * 5 + 501)
    assert np.ptp(log.samples(0.0, 300.0).t) <= 1.2 * 20.0 + 0.21


def test_a_single_outlier_is_left_out_once_the_next_report_is_back():
    t, r = drive(0.3)
    wild = int(np.flatnonzero((r.vehicle == 1) & (t > 10.05))[0])
    moved = r.p_enu.copy()
    moved[wild, 0] += 8.0
    log, clean = ReportLog(3, 20.0), ReportLog(3, 20.0)
    until = int(np.flatnonzero(t <= t[wild])[-1]) + 1
    log.add(*pick(t, replace(r, p_enu=moved), slice(0, until)))
    assert log.samples(0.0, 20.0).jump_var.max() > 6.0**2, "the newest may be the first of many"
    log.add(*pick(t, replace(r, p_enu=moved), slice(until, None)))
    clean.add(*pick(t, r, np.delete(np.arange(len(t)), wild)))
    got, wanted = log.samples(0.0, 20.0), clean.samples(0.0, 20.0)
    np.testing.assert_array_equal(got.t, wanted.t)
    white = log.white_index
    np.testing.assert_allclose(got.log_null[:, white], wanted.log_null[:, white])
    assert not got.jump_var.any()


@pytest.mark.parametrize("hz", [6.0, 10.0, 16.7, 20.0, 50.0])
def test_reports_that_come_often_count_by_time(hz):
    often, seldom = ReportLog(3, 20.0), ReportLog(3, 20.0)
    often.add(*drive(0.0, hz=hz))
    seldom.add(*drive(0.0))
    a, b = often.samples(0.0, 20.0), seldom.samples(0.0, 20.0)
    assert 0.6 * len(b.t) < len(a.t) < 1.5 * len(b.t)
    # at the mean of their times they are at the mean of their places: curves of 9 m radius within 0.15 s
    at = np.stack([4.0 * a.t, 10.0 * np.sin(0.3 * a.t + a.vehicle) + 8.0 * a.vehicle], axis=1)
    assert np.abs(a.p - at).max() < 0.01
    # what their own past foresees of a second is nearly the same however often they come
    foreseen = [np.sum(log.samples(5.0, 20.0).log_null[:, 4]) / 45.0 for log in (often, seldom)]
    assert foreseen[0] == pytest.approx(foreseen[1], abs=0.5)


def test_the_newest_report_is_known_at_once_though_it_is_averaged():
    log = ReportLog(1, 20.0)
    t, r = drive(0.0, n=1, hz=50.0)
    log.add(*pick(t, r, slice(0, 5)))
    p, age = log.extrapolated(t[4])
    np.testing.assert_allclose(p[0], r.p_enu[4, :2])
    assert age[0] == 0.0 and len(log.samples(0.0, 1.0).t) == 1


def test_begun_anew_a_log_has_the_newest_places_alone():
    log = ReportLog(3, 20.0)
    log.add(*drive(0.3))
    anew = log.begun_anew()
    assert not len(anew.samples(0.0, 30.0).t)
    np.testing.assert_array_equal(anew.extrapolated(21.0)[0], log.extrapolated(21.0)[0])
    place, age = anew.extrapolated(float(anew.last_t.min()) - 2.0)
    np.testing.assert_allclose(place, anew.last_p + anew.last_v * age[:, None], err_msg="nothing lies between")


def test_a_report_that_is_rejected_is_none_that_is_believed():
    log = ReportLog(3, 20.0)
    log.add(*drive(0.3))
    log.rejected_since = np.array([np.inf, 5.0, np.inf])
    assert log.believed_t.tolist() == [log.last_t[0], 5.0, log.last_t[2]]
