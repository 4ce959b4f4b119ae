"""The part of the picture that is shown: the fleet in it, calm, and what is drawn is where it was."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from gcs.snapshot import Candidate
from gcs.tui.framing import LOOSE_US, frame_for, framed
from gcs.tui.panes.video import VideoPane
from tests.support.fake_station import HEIGHT, WIDTH, make_snapshot, running, text_of

BASE = make_snapshot()
WHOLE = (0, 0, WIDTH, HEIGHT)
NEAR = tuple(box for box in BASE.boxes if box.system_id in (11, 12))
STRANGER = replace(BASE.boxes[-2], cx=1200.0, cy=690.0)


def with_boxes(*boxes, later_us=0, expected=None):
    rows = tuple(replace(row, expected_px=expected if row.system_id == 16 else None) for row in BASE.vehicles)
    return replace(BASE, boxes=boxes, vehicles=rows, t_us=BASE.t_us + later_us)


def shown(snapshot, x, y, pick=(0, 0)):
    left, top, width, height = frame_for(snapshot, pick, 16 / 9).rect
    return left <= x < left + width and top <= y < top + height


def moved(boxes, east_px):
    return tuple(replace(box, cx=box.cx + east_px) for box in boxes)


@pytest.mark.parametrize("shape", [0.8, 16 / 9, 4.0])
def test_it_has_the_fleet_and_not_the_meadow(shape):
    frame = frame_for(with_boxes(*NEAR), (0, 0), shape)
    left, top, width, height = frame.rect
    assert left >= 0 and top >= 0 and left + width <= WIDTH and top + height <= HEIGHT
    assert all(shown(with_boxes(*NEAR), box.cx, box.cy) for box in NEAR) and width * height < 0.7 * WIDTH * HEIGHT


@pytest.mark.parametrize(
    ("none_of_ours", "pick", "seen"), [(0.9, (0, 0), False), (0.9, (0, 21), True), (0.2, (0, 0), True)]
)
def test_a_stranger_is_no_reason_to_show_the_whole(none_of_ours, pick, seen):
    box = replace(STRANGER, none_of_ours=none_of_ours, candidates=(Candidate(system_id=15, confidence=0.1),))
    assert shown(with_boxes(*NEAR, box), box.cx, box.cy, pick) is seen


def test_it_has_where_vehicles_report_to_be_and_the_whole_where_nothing_is_known():
    assert shown(with_boxes(*NEAR, expected=(1200.0, 690.0)), 1200.0, 690.0)
    assert frame_for(with_boxes(), (0, 0), 1.5).rect == WHOLE


def test_it_moves_only_when_needed():
    first = frame_for(with_boxes(*NEAR), (0, 0), 1.5)
    still = frame_for(with_boxes(*moved(NEAR, 15.0)), (0, 0), 1.5, first)
    assert still.rect == first.rect
    away = frame_for(with_boxes(*moved(NEAR, 500.0)), (0, 0), 1.5, still)
    assert away.rect != first.rect and all(box.cx < away.rect[0] + away.rect[2] for box in moved(NEAR, 500.0))
    whole = replace(first, rect=WHOLE)
    for later_us, closer in ((0, False), (LOOSE_US // 2, False), (LOOSE_US, True)):
        whole = frame_for(with_boxes(*NEAR, later_us=later_us), (0, 0), 1.5, whole)
        assert (whole.rect != WHOLE) is closer


def test_boxes_images_and_expected_places_are_counted_from_its_corner():
    snapshot = with_boxes(*NEAR, STRANGER, expected=(500.0, 300.0))
    frame = frame_for(with_boxes(*NEAR), (0, 0), 1.5)
    part = framed(snapshot, frame)
    left, top, width, height = frame.rect
    np.testing.assert_array_equal(part.image, snapshot.image[top : top + height, left : left + width])
    assert [(box.cx + left, box.cy + top) for box in part.boxes] == [(box.cx, box.cy) for box in NEAR]
    assert next(row for row in part.vehicles if row.system_id == 16).expected_px == (500.0 - left, 300.0 - top)


async def test_the_heading_says_how_close_it_is_and_the_whole_screen_has_the_whole():
    async with running(size=(120, 40)) as (app, pilot, station):
        station.snapshot = with_boxes(*NEAR, STRANGER)
        app._poll()
        await pilot.pause()
        video = app.query_one(VideoPane)
        assert re.search(r"zoom 1\.\d · 1 beyond · 25 fps · ", text_of(video).splitlines()[0])
        await pilot.press("v", "z")
        assert "beyond" not in text_of(video).splitlines()[0]
