"""The picked vehicle enlarged: which part of the image, in which corner, and that nothing else is lost by it."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest

from gcs.report.inset import crop, inset_for, moved_boxes, title_of
from gcs.report.overlay import draw, image_inset, image_labels
from gcs.tui.draw.cell_labels import measure_cells
from gcs.tui.draw.mosaic import PictureMode, fit
from gcs.tui.draw.video_canvas import video_cells, video_inset, video_labels
from tests.support.fake_station import HEIGHT, WIDTH, make_snapshot, running, screen_text

SNAPSHOT = make_snapshot()
BOXES = {each.system_id: each for each in SNAPSHOT.boxes if each.system_id}


def meet(a, b):
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def at(cx, cy, system_id=11, w=60.0):
    return replace(BOXES[11], cx=cx, cy=cy, w=w, h=w / 2, system_id=system_id, track_id=system_id)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("cx", [5.0, 300.0, 640.0, 1000.0, 1275.0])
@pytest.mark.parametrize("cy", [5.0, 200.0, 360.0, 715.0])
def test_it_covers_neither_the_picked_box_nor_any_label(cx, cy):
    snapshot = replace(SNAPSHOT, boxes=(at(cx, cy), *(each for each in SNAPSHOT.boxes if each.system_id != 11)))
    for columns, rows in ((47, 20), (80, 24), (120, 34)):
        inset = video_inset(snapshot, 11, columns, rows)
        left, top, wide, high = fit(WIDTH, HEIGHT, columns, rows)
        x, y = left + cx * wide / WIDTH, top + cy * high / HEIGHT
        assert not meet(inset.rect, (x, y, 0.1, 0.1))
        right, bottom = inset.rect[0] + inset.rect[2], inset.rect[1] + inset.rect[3]
        assert min(inset.rect[:2]) >= 0 and right <= columns and bottom <= rows
        labelling = video_labels(snapshot, 11, columns, rows, inset=inset)
        assert not any(meet(place.rect, inset.rect) for place in labelling.texts)
        shown = [strip.text for strip in video_cells(snapshot, 11, columns, rows, 0, labelling, inset=inset).strips()]
        for place in labelling.texts:
            assert place.text in shown[place.rect[1]]


def test_the_part_is_around_the_vehicle_inside_the_image_and_in_the_shape_of_the_window():
    for cx, cy in ((640.0, 360.0), (2.0, 3.0), (1279.0, 719.0)):
        snapshot = replace(SNAPSHOT, boxes=(at(cx, cy),))
        inset = video_inset(snapshot, 11, 80, 24)
        left, top, width, height = inset.part
        assert 0 <= left <= cx <= left + width <= WIDTH and 0 <= top <= cy <= top + height <= HEIGHT
        assert width / height == pytest.approx(inset.rect[2] / (2 * inset.rect[3]))
        assert min(width, height) == pytest.approx(2.4 * 60.0)
        assert crop(snapshot, inset).shape[:2] == pytest.approx((height, width), abs=1.5)


def test_a_vehicle_of_30_px_has_many_cells_on_a_small_screen():
    """At 80×24 the picture has 47 columns: the vehicle is one of them, enlarged it is seven and more."""
    image = np.zeros_like(SNAPSHOT.image)
    cv2.rectangle(image, (625, 352), (654, 367), (255, 255, 255), -1)
    snapshot = replace(SNAPSHOT, image=image, boxes=(at(640.0, 360.0, w=30.0),))
    inset = video_inset(snapshot, 11, 47, 20)
    for grain in ("halves", "sextants", "octants"):
        bright = []
        for each in (None, replace(inset, seen=False)):
            cells = video_cells(replace(snapshot, boxes=()), 11, 47, 20, mode=PictureMode(grain=grain), inset=each)
            bright.append(int(((cells.ink >> 8 & 255) > 128).sum() + ((cells.paper >> 8 & 255) > 128).sum()))
        assert bright[1] - bright[0] > 30, grain


def test_it_stays_in_its_corner_until_another_is_better():
    corners = []
    inset = None
    for cx in range(400, 900, 4):
        inset = video_inset(replace(SNAPSHOT, boxes=(at(float(cx), 200.0),)), 11, 80, 24, former=inset)
        corners.append(inset.rect[:2])
    assert sum(a != b for a, b in itertools.pairwise(corners)) <= 1


def test_without_a_box_it_shows_where_the_vehicle_should_be_and_nothing_where_that_is_outside():
    def expected(place):
        rows = tuple(replace(row, expected_px=place) if row.system_id == 17 else row for row in SNAPSHOT.vehicles)
        return replace(SNAPSHOT, vehicles=rows)

    inset = video_inset(expected((900.0, 300.0)), 17, 80, 24)
    assert not inset.seen
    left, top, width, height = inset.part
    assert (left + width / 2, top + height / 2) == pytest.approx((900.0, 300.0))
    for place in (None, (-3.0, 300.0), (900.0, 720.0), (float("nan"), 1.0)):
        assert video_inset(expected(place), 17, 80, 24) is None
    assert video_inset(SNAPSHOT, 0, 80, 24) is None
    assert video_inset(SNAPSHOT, 0, 80, 24, 21).seen, "a picked box without a name"
    assert video_inset(SNAPSHOT, 11, 20, 6) is None, "no room"


def test_boxes_are_where_they_are_in_the_part():
    inset = inset_for(SNAPSHOT, 11, (0, 0, 40, 40), [], BOXES[11])
    (own,) = (each for each in moved_boxes(SNAPSHOT.boxes, inset) if each.system_id == 11)
    assert (own.cx + inset.part[0], own.cy + inset.part[1]) == (BOXES[11].cx, BOXES[11].cy)
    assert not any(each.system_id == 14 for each in moved_boxes(SNAPSHOT.boxes, inset))


def test_in_pixels_it_is_the_image_at_full_resolution_and_no_label_is_on_it():
    for scale in (0.4, 1.0):
        inset = image_inset(SNAPSHOT, scale=scale, selected=12)
        labelling = image_labels(SNAPSHOT, scale=scale, selected=12, inset=inset)
        image = draw(SNAPSHOT, scale=scale, selected=12, labelling=labelling, inset=inset)
        plain = draw(SNAPSHOT, scale=scale, selected=12)
        assert image.shape == plain.shape
        x, y, width, height = inset.rect
        part = cv2.resize(crop(SNAPSHOT, inset), (width, height), interpolation=cv2.INTER_CUBIC)
        shown = image[y : y + height, x : x + width]
        alike = (np.abs(shown.astype(int) - part).max(axis=-1) == 0).mean()
        assert alike > 0.5, "but for the box, the title and the frame"
        assert (image[:y] == plain[:y]).mean() > 0.9


def test_a_title_is_whole_or_something_shorter_and_names_nothing_that_is_not_seen():
    def title(room, label="UGV-11? 61%", seen=True):
        return title_of(label, 5.0, seen=seen, shows=lambda text: measure_cells(text)[0] <= room)

    assert [title(room) for room in (20, 11, 5, 2)] == ["UGV-11? 61% x5.0", "UGV-11? 61%", "x5.0", ""]
    assert title(20, "?") == "? x5.0"
    assert [title(room, "UGV-17", seen=False) for room in (20, 10)] == ["UGV-17 expected", "expected"]


async def test_the_key_shows_and_hides_it_and_says_why_there_is_none():
    async with running() as (app, pilot, _):
        await pilot.press("Z")
        assert "pick a vehicle" in screen_text(app)
        await pilot.press("down", "down")
        assert app.selected == 11 and "UGV-11 97% x" in screen_text(app)
        await pilot.press(*["down"] * 5)
        assert app.selected == 16 and "not in the picture" in screen_text(app)
        await pilot.press("Z")
        assert "not in the picture" not in screen_text(app)


async def test_a_click_on_it_picks_nothing_below():
    async with running() as (app, pilot, _):
        await pilot.press("down", "down", "Z")
        x, y, *_ = app.query_one("#video")._inset.rect
        await pilot.click("#video", offset=(x + 2, y + 3))
        assert app.selected == 11
