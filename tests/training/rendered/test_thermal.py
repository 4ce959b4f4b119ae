"""Scenes as thermal cameras see them."""

from __future__ import annotations

import numpy as np

from sim.world.view import Bodies, CameraView
from training.rendered.thermal import as_thermal, draw_traces, warmed


def view(side=200, height=40.0, focal=400.0):
    return CameraView(
        width=side, height=side, fx=focal, fy=focal, cx=side / 2, cy=side / 2, distortion=np.zeros(5),
        R_enu_cam=np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]), p_enu=np.array([0.0, 0.0, height]),
    )  # fmt: skip


def row_of(count):
    one = np.ones(count)
    return Bodies(
        kind=np.full(count, 10, np.int8),
        x=np.arange(count) * 5.0,
        y=0.0 * one,
        heading=0.0 * one,
        length=4.5 * one,
        width=1.8 * one,
        height=1.5 * one,
        color=np.tile(np.array([[20, 120, 240]], np.uint8), (count, 1)),
    )


def test_bodies_are_as_grey_as_they_are_warm_and_the_living_are_the_warmest():
    vehicle, alive = np.arange(60) < 20, np.arange(60) >= 40
    for seed in range(8):
        bodies = row_of(60)
        grey = warmed(bodies, vehicle, alive, np.random.default_rng(seed)).color
        assert (grey == grey[:, :1]).all()
        assert grey[alive].min() >= 200
        assert (bodies.color == [20, 120, 240]).all()


def test_most_vehicles_of_an_image_are_about_as_warm():
    for seed in range(8):
        grey = warmed(row_of(60), np.ones(60, bool), np.zeros(60, bool), np.random.default_rng(seed)).color[:, 0]
        assert np.subtract(*np.percentile(grey, (60, 20))) < 60


def test_a_car_leaves_a_trace_where_it_stood_and_nowhere_else():
    image = np.full((200, 200, 3), 120, np.uint8)
    draw_traces(image, view(), np.array([[0.0, 0.0, 0.0, 5.0]]), np.random.default_rng(1))
    # 4 m by 1.7 m at 10 px a metre, and a soft edge
    assert abs(int(image[100, 100, 0]) - 120) > 5
    assert (image[:, :70] == 120).all() and (image[:50] == 120).all()
    steps = np.abs(np.diff(image[100, :, 0].astype(int)))
    assert steps.max() < 0.5 * abs(int(image[100, 100, 0]) - 120)


def test_no_place_no_trace():
    image = np.full((50, 50, 3), 120, np.uint8)
    draw_traces(image, view(50), np.zeros((0, 4)), np.random.default_rng(1))
    assert (image == 120).all()


def test_the_camera_shows_warm_light_or_warm_dark_in_one_channel():
    scene = np.full((64, 64, 3), 60, np.uint8)
    scene[24:40, 24:40] = 220
    lighter = []
    for seed in range(30):
        image = as_thermal(scene, np.random.default_rng(seed))
        assert image.shape == scene.shape and image.dtype == np.uint8
        assert np.ptp(image.astype(int), axis=-1).max() == 0
        lighter.append(image[28:36, 28:36].mean() > image[:12].mean())
    assert 15 <= sum(lighter) < 30
