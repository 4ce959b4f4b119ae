"""Fronts of tracks: by what boxes tell, and by where their vehicles drive."""

import numpy as np
import pytest

from tests.support.snapshots import STEP, boxes
from vision.track.tracker import Tracker

STILL = np.eye(3)
LENGTH = 40.0
SPEED = 5.0
"""px a frame: a length in 8 frames."""


def drive(heading, frames=30, *, speed=SPEED, warp=STILL, tracker=None, start=100.0):
    """Headings, degrees, of a track that drives right; its boxes tell ``heading``, rad, or none (NaN)."""
    tracker, out = tracker or Tracker(), []
    for k in range(frames):
        angle = 0.0 if np.isnan(heading) else heading - 0.5 * np.pi
        seen = boxes([[start + speed * k, 100.0]], angle=angle, heading=heading, w=LENGTH)
        tracks = tracker.update(seen, tracker_time(tracker), warp=warp)
        out.append(float(np.degrees(tracks.heading[0])))
    return np.array(out)


def tracker_time(tracker):
    """The time of its next frame."""
    last = vars(tracker)["_t_us"]
    return 0 if last is None else last + STEP


def test_two_lengths_outvote_every_box_that_is_turned_about():
    heading = drive(np.radians(270.0))
    np.testing.assert_allclose(heading[:5], 270.0)
    np.testing.assert_allclose(heading[16:], 90.0, atol=1e-6)


def test_a_vehicle_whose_boxes_tell_no_front_shows_it_by_driving():
    heading = drive(np.nan)
    assert np.isnan(heading[:6]).all()
    np.testing.assert_allclose(heading[16:], 90.0, atol=1e-6)
    assert np.isnan(drive(np.nan, speed=-SPEED)[:6]).all()
    np.testing.assert_allclose(drive(np.nan, speed=-SPEED)[16:], 270.0, atol=1e-6)


@pytest.mark.parametrize(("speed", "warp"), [(0.3, STILL), (SPEED, None)])
def test_rest_and_unknown_camera_motion_tell_nothing(speed, warp):
    np.testing.assert_allclose(drive(np.radians(270.0), 60, speed=speed, warp=warp), 270.0)


def test_the_cameras_motion_is_no_drive():
    warp = np.array([[1.0, 0.0, SPEED], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(drive(np.radians(270.0), 60, warp=warp), 270.0)


def test_who_backs_up_after_a_drive_keeps_its_front():
    tracker = Tracker()
    drive(np.radians(90.0), 40, tracker=tracker)
    back = drive(np.radians(90.0), 15, speed=-SPEED, tracker=tracker, start=100.0 + SPEED * 39)
    np.testing.assert_allclose(back, 90.0)


def test_a_box_across_its_motion_tells_no_front():
    """Its axis is not the vehicle's."""
    tracker = Tracker()
    for k in range(40):
        seen = boxes([[100.0 + SPEED * k, 100.0]], angle=0.5 * np.pi, w=30.0, h=28.0)
        tracks = tracker.update(seen, k * STEP, warp=STILL)
    assert np.isnan(tracks.heading).all()
