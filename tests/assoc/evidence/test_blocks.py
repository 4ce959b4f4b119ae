"""Residuals by block: right for a hand-made pair, and the same for large fleets wherever it matters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from assoc.evidence import blocks as module
from assoc.evidence.blocks import make_blocks
from assoc.evidence.motion import WHITE_STD_M, Samples
from assoc.geometry.ground import THETA, GroundTracks


def scene(n, seconds=6.0, seed=3):
    """n vehicles on a wide field, each with a track half a metre east of it at 10 Hz and reports at 5 Hz."""
    rng = np.random.default_rng(seed)
    start, v = rng.uniform(0, 200, (n, 2)), rng.uniform(-4, 4, (n, 2))
    t = np.arange(0.0, seconds, 0.1)
    p = start + v * t[:, None, None] + (0.5, 0.0)
    heading = np.broadcast_to(np.arctan2(v[:, 0], v[:, 1]), (len(t), n))
    tracks = GroundTracks(
        t=t,
        p=p,
        jacobian=np.zeros((len(t), n, 2, THETA)),
        heading=heading,
        pixel_m=np.full((len(t), n), PIXEL_M),
        theta=np.zeros(THETA),
    )
    said = np.tile(np.arange(0.05, seconds, 0.2), n)
    vehicle = np.repeat(np.arange(n), len(said) // n)
    samples = Samples(
        t=said,
        vehicle=vehicle,
        p=start[vehicle] + v[vehicle] * said[:, None],
        heading=heading[0, vehicle],
        log_null=np.full((len(said), len(WHITE_STD_M)), -2.0),
        jump_var=np.zeros(len(said)),
    )
    return tracks, samples


PIXEL_VAR, PIXEL_M = 2.25, 0.05


def blocks(tracks, samples, n):
    numbers = {"block_s": 1.0, "gap_max_s": 0.6, "heading_std": 0.15, "white_var": 0.09, "pixel_var": PIXEL_VAR}
    return make_blocks(tracks, samples, n, first=0, last=6, **numbers)


def made(n):
    return blocks(*scene(n), n)


def test_a_track_half_a_metre_aside():
    got = made(2)
    own = np.arange(2)
    np.testing.assert_allclose(got.count[1:5, own, own], 5.0)
    np.testing.assert_allclose(got.mean[1:5, own, own], np.broadcast_to((0.5, 0.0), (4, 2, 2)), atol=1e-9)
    np.testing.assert_allclose(got.scatter[1:5, own, own], 0.0, atol=1e-9)
    np.testing.assert_allclose(got.log_null[1:5, own, own], -10.0)
    assert (got.heading[own, own] > 0).all()
    assert (got.count[6] == 0).all()


def test_large_fleets_leave_out_only_pairs_that_were_never_near(monkeypatch):
    some = made(25)
    monkeypatch.setattr(module, "MANY_PAIRS", 10_000)
    everything = made(25)
    near = (np.hypot(everything.mean[..., 0], everything.mean[..., 1]) < 24.0) & (everything.count > 0)
    near = near.any(axis=0)
    assert 25 <= near.sum() < 0.3 * near.size
    for name in ("count", "mean", "scatter", "log_null"):
        np.testing.assert_allclose(getattr(some, name)[:, near], getattr(everything, name)[:, near], atol=1e-9)
    np.testing.assert_allclose(some.heading[near], everything.heading[near])
    left_out = (some.count.sum(axis=0) == 0) & (everything.count.sum(axis=0) > 0)
    assert left_out.sum() > 0.5 * near.size


@pytest.mark.parametrize("gap_s", [0.4, 1.0])
def test_holes_are_bridged_while_they_are_short(gap_s):
    tracks, samples = scene(1)
    hole = (tracks.t > 2.5) & (tracks.t < 2.5 + gap_s)
    p = np.where(hole[:, None, None], np.nan, tracks.p)
    holed = GroundTracks(
        t=tracks.t, p=p, jacobian=tracks.jacobian, heading=tracks.heading, pixel_m=tracks.pixel_m, theta=tracks.theta
    )
    got = blocks(holed, samples, 1)
    inside = np.count_nonzero((samples.t > 2.5) & (samples.t < 2.4 + gap_s))
    assert got.count.sum() == pytest.approx(30 - (0 if gap_s < 0.6 else inside), abs=2)


@pytest.mark.parametrize("std", [0.0, 0.1, 0.4])
def test_how_much_boxes_scatter_is_seen_from_the_boxes(std):
    tracks, samples = scene(4)
    noisy = replace(tracks, p=tracks.p + np.random.default_rng(5).normal(0.0, std, tracks.p.shape))
    got = blocks(noisy, samples, 4)
    # what is assumed of a detector still counts a little
    least = 0.3 * PIXEL_VAR * PIXEL_M**2
    assert got.box_var[1:5].min() > min(0.5 * std**2, least) and got.box_var.max() < 1.5 * std**2 + least


@pytest.mark.parametrize("every", [5, 10])
def test_boxes_that_come_once_or_twice_a_second_show_their_noise_too(every):
    tracks, samples = scene(20)
    noisy = replace(tracks, p=tracks.p + np.random.default_rng(5).normal(0.0, 0.4, tracks.p.shape))
    few = {name: getattr(noisy, name)[::every] for name in ("t", "p", "jacobian", "heading", "pixel_m")}
    seen = blocks(replace(noisy, **few), samples, 20).box_var
    assert 0.5 * 0.4**2 < np.mean(seen[seen > 0.0]) < 1.5 * 0.4**2


def test_a_track_that_leaps_does_not_make_all_boxes_noisy():
    tracks, samples = scene(4)
    leapt = tracks.p.copy()
    leapt[25:, 0] += 9.0
    assert blocks(replace(tracks, p=leapt), samples, 4).box_var[:, 1:].max() < 0.1


def test_what_the_past_foresees_is_taken_for_the_noise_of_boxes_and_reports_together():
    tracks, samples = scene(1)
    by_noise = replace(samples, log_null=np.tile(np.log(WHITE_STD_M), (len(samples.t), 1)))
    got = blocks(tracks, by_noise, 1)
    expected = 0.5 * np.log(0.09 + got.box_var[2, 0])
    assert got.log_null[2, 0, 0] / got.count[2, 0, 0] == pytest.approx(expected, abs=1e-9)
