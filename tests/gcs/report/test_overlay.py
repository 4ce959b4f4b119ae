from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.report.box_shapes import box_bounds, box_corners, front_mark
from gcs.report.label_grid import Grid
from gcs.report.labels import COUNT_KEY, Label, place_labels
from gcs.report.overlay import (
    STANDING_RGB,
    box_labels,
    box_texts,
    draw,
    image_labels,
    label_of,
    named_count,
    rgb_of,
    standing_of,
)
from gcs.report.vehicle_names import ShownName
from gcs.snapshot import Alarm
from tests.support.fake_station import HOSTILE, make_snapshot

SNAPSHOT = make_snapshot()
BOX = SNAPSHOT.boxes[0]


def overlap(a, b):
    return max(0, min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])) * max(
        0, min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    )


def test_image_is_copied_not_drawn_upon():
    before = SNAPSHOT.image.copy()
    drawn = draw(SNAPSHOT)
    assert drawn.shape == SNAPSHOT.image.shape and drawn.dtype == np.uint8
    assert np.array_equal(SNAPSHOT.image, before)
    assert not np.shares_memory(drawn, SNAPSHOT.image)
    assert not np.array_equal(drawn, before)


@pytest.mark.parametrize(("scale", "shape"), [(0.5, (360, 640, 3)), (1.0, (720, 1280, 3)), (1.5, (1080, 1920, 3))])
def test_scale_sets_the_size(scale, shape):
    assert draw(SNAPSHOT, scale=scale).shape == shape


def test_no_image_gives_a_dark_canvas_with_boxes():
    drawn = draw(replace(SNAPSHOT, image=None))
    assert drawn.shape == (720, 1280, 3)
    assert np.median(drawn) < 40
    assert (drawn == np.array(STANDING_RGB["coasting"][::-1])).all(axis=2).any()


def test_no_image_size_at_all_still_draws():
    assert draw(replace(SNAPSHOT, image=None, width=0, height=0, boxes=())).shape == (720, 1280, 3)


def test_every_standing_has_its_colour_on_the_image():
    drawn = draw(replace(SNAPSHOT, image=None))
    for standing in ("confirmed", "tentative", "coasting", "unidentified"):
        assert (drawn == np.array(STANDING_RGB[standing][::-1])).all(axis=2).sum() > 10, standing


def test_a_name_on_which_nobody_is_to_act_has_a_mark_and_an_alarms_colour():
    doubt = Alarm(
        key="d", level="alarm", kind="identity", text="x", advice="x", since_us=0, system_id=11, doubts_name=True
    )
    doubted = replace(SNAPSHOT, alarms=(doubt,))
    assert label_of(doubted, BOX) == "!UGV-11 97%"
    assert label_of(doubted, replace(BOX, coasting=True)).startswith("!~UGV-11")
    assert not label_of(doubted, SNAPSHOT.boxes[1]).startswith("!")
    assert rgb_of(doubted, BOX) == STANDING_RGB["misplaced"] != rgb_of(SNAPSHOT, BOX)
    red = np.array(STANDING_RGB["misplaced"][::-1])
    assert (draw(replace(doubted, image=None)) == red).all(axis=2).sum() > 10
    assert not (draw(replace(SNAPSHOT, image=None)) == red).all(axis=2).any()


def test_selected_label_is_filled_with_its_colour():
    colour = np.array(STANDING_RGB["confirmed"][::-1])
    plain, stressed = (draw(replace(SNAPSHOT, image=None), selected=who) for who in (0, 12))
    assert (stressed == colour).all(axis=2).sum() > (plain == colour).all(axis=2).sum() + 500


def test_labels_say_the_standing_in_signs():
    assert [label_of(SNAPSHOT, box) for box in SNAPSHOT.boxes] == [
        "UGV-11 97%",
        "UGV-12 99%",
        "UGV-13? 61%",
        "~UGV-14 88%",
        "?",
        "?",
    ]


def test_a_box_whose_vehicle_is_not_in_the_table_is_tentative():
    assert standing_of(SNAPSHOT, replace(BOX, system_id=99)) == "tentative"
    assert label_of(SNAPSHOT, replace(BOX, system_id=99, confidence=math.nan)) == "UGV-99?"


def test_nothing_is_said_to_be_certain():
    assert label_of(SNAPSHOT, replace(BOX, confidence=1.0)) == "UGV-11 99%"
    assert label_of(SNAPSHOT, replace(BOX, confidence=0.004)) == "UGV-11 0%"


def test_named_count_leaves_the_uav_out():
    assert named_count(SNAPSHOT) == (2, 7)


def test_corners_turn_clockwise_on_screen():
    corners = box_corners(replace(BOX, cx=0.0, cy=0.0, w=4.0, h=2.0, angle=math.pi / 2))
    assert corners == pytest.approx(np.array([(1, -2), (1, 2), (-1, 2), (-1, -2)]), abs=1e-12)


@given(heading=st.floats(0, 2 * math.pi), w=st.floats(10, 80), h=st.floats(5, 80))
@settings(max_examples=40, deadline=None)
def test_front_mark_starts_on_the_edge_ahead(heading, w, h):
    box = replace(BOX, cx=0.0, cy=0.0, w=w, h=h, angle=heading - math.pi / 2, heading=heading)
    start, end = front_mark(box, reach=0.5)
    ahead = np.array([math.sin(heading), -math.cos(heading)])
    assert start == pytest.approx(ahead * w / 2, abs=1e-6)
    assert end == pytest.approx(ahead * w, abs=1e-6)


def test_unknown_front_has_no_mark_and_still_has_bounds():
    box = replace(BOX, heading=math.nan, angle=0.0, cx=50.0, cy=40.0, w=20.0, h=10.0)
    assert np.isnan(front_mark(box)).all()
    assert box_bounds(box) == (40.0, 35.0, 20.0, 10.0)


def grid_of(columns, rows, **change):
    return Grid(columns=columns, rows=rows, measure=lambda text: (len(text), 1), covered=True, **change)


def test_crowded_labels_do_not_cover_each_other():
    labels = [Label(key=i, anchor=(100 + 30 * i, 100, 25, 20), texts=("a" * 28,)) for i in range(4)]
    places = place_labels(labels, grid_of(400, 300)).places
    assert len(places) == 4
    assert all(overlap(a.rect, b.rect) == 0 for a, b in combinations(places, 2))


def test_labels_stay_in_the_image():
    anchors = [(-20, -20, 30, 30), (390, 290, 30, 30)]
    labels = [Label(key=i, anchor=anchor, texts=("a" * 60,)) for i, anchor in enumerate(anchors)]
    places = place_labels(labels, grid_of(400, 300)).places
    assert len(places) == 2
    for place in places:
        x, y, w, h = place.rect
        assert x >= 0 and x + w <= 400 and y >= 0 and y + h <= 300


def test_a_label_of_a_mark_outside_is_left_out():
    label = Label(key=1, anchor=(-40, 5, 30, 3), texts=("a",))
    assert place_labels([label], grid_of(40, 20)).texts == ()


def test_what_finds_no_place_is_counted():
    labels = [Label(key=i, anchor=(5, 0, 1, 1), texts=("abcde", "ab")) for i in range(1, 9)]
    labelling = place_labels(labels, grid_of(10, 1))
    assert sum(int(place.text.split()[0]) for place in labelling.counts) == 8 - len(labelling.places)
    assert labelling.counts


@pytest.mark.parametrize("columns", [12, 16, 24])
def test_an_id_that_there_is_no_room_to_explain_is_counted(columns):
    labels = [
        Label(
            key=i,
            anchor=(3 * i % columns, 2 + i % 5, 2, 1),
            texts=(f"vehicle {i}", f"{i}"),
            legend=f"{i} = vehicle {i}",
        )
        for i in range(10, 30)
    ]
    shown = place_labels(labels, grid_of(columns, 9))
    short = {place.key for place in shown.places if place.form}
    assert short <= {place.key for place in shown.legend}
    counted = sum(int(place.text.split()[0]) for place in shown.counts)
    assert counted > 0 and len(shown.places) + counted == len(labels)
    of_all = [place for place in shown.counts if place.key == COUNT_KEY]
    assert all(place.text.endswith(" names") and len(place.text) <= place.rect[2] for place in of_all)
    assert of_all or columns > 12


def test_in_a_crowd_only_names_that_are_not_sure_have_their_certainty():
    sure, doubted, guessed = (replace(BOX, track_id=k, system_id=k, cx=100.0 * k) for k in (11, 12, 13))
    rows = [replace(SNAPSHOT.vehicles[1], system_id=k, standing="confirmed") for k in range(1, 18)]
    rows[12] = replace(rows[12], standing="tentative")
    told = Alarm(key="", level="alarm", kind="", text="", advice="", since_us=0, system_id=12, doubts_name=True)
    snapshot = replace(SNAPSHOT, vehicles=tuple(rows), alarms=(told,))
    boxes = (sure, doubted, guessed)

    def certain(snapshot, pick=0):
        labels = box_labels(snapshot, boxes, [(0, 0, 1, 1)] * 3, str.isascii, (pick, 0))
        return ["%" in label.texts[0] for label in labels]

    assert certain(snapshot) == [False, True, True] and certain(snapshot, pick=11) == [True] * 3
    assert certain(replace(snapshot, vehicles=tuple(rows[10:]))) == [True] * 3, "few"


@pytest.mark.parametrize("scale", [0.3, 0.5, 1.0, 1.5])
def test_names_on_the_image_cover_neither_each_other_nor_the_header(scale):
    heaps = [
        replace(BOX, track_id=n + 1, system_id=n + 1, cx=200 + 5 * (n % 4) + 300 * (n % 3), cy=300 + 9 * (n // 4))
        for n in range(40)
    ]
    crowd = replace(SNAPSHOT, boxes=tuple(heaps), image=None)
    labelling = image_labels(crowd, scale=scale)
    rects = [place.rect for place in labelling.texts]
    assert all(overlap(a, b) == 0 for a, b in combinations(rects, 2))
    assert len(labelling.places) + sum(int(place.text.split()[0]) for place in labelling.counts) == 40
    drawn = draw(crowd, scale=scale, labelling=labelling)
    bare = draw(crowd, scale=scale, labelling=replace(labelling, places=(), counts=(), legend=()))
    # every text lies in the image: no pixel of the header is touched, and something is drawn in each place
    unit = max(0.75, drawn.shape[0] / 900)
    square = max(2, round(4 * unit))
    head = np.s_[: round(8 * unit), : round(100 * unit)]
    assert np.array_equal(drawn[head], bare[head])
    for left, top, width, height in rects:
        window = np.s_[top * square : (top + height) * square, left * square : (left + width) * square]
        assert drawn[window].shape[:2] == (height * square, width * square)
        assert (drawn[window] != np.array((26, 18, 14))).any()


def test_a_name_that_opencv_cannot_write_is_its_id():
    rows = tuple(replace(row, name="漢字") if row.system_id == 11 else row for row in SNAPSHOT.vehicles)
    texts = [place.text for place in image_labels(replace(SNAPSHOT, vehicles=rows)).places]
    assert "11 97%" in texts and "UGV-12 99%" in texts


def test_the_header_is_never_cut():
    small = replace(SNAPSHOT, width=160, height=90, image=None, boxes=())
    wide = draw(replace(SNAPSHOT, image=None, boxes=()))
    assert (draw(small)[:, -1] == draw(small)[-1, -1]).all()
    assert (wide[:20, :300] != draw(small)[-1, -1]).any()


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_are_drawn(text):
    rows = tuple(replace(row, name=text) for row in SNAPSHOT.vehicles)
    assert draw(replace(SNAPSHOT, vehicles=rows), scale=0.5).shape == (360, 640, 3)


def test_boxes_far_outside_the_image_do_no_harm():
    far = replace(BOX, cx=-5000.0, cy=9000.0)
    assert draw(replace(SNAPSHOT, boxes=(far,))).shape == (720, 1280, 3)


@given(st.lists(st.sampled_from([math.nan, math.inf, -1.0, 0.0, 1e12, -1e300, 3.0, 500.0]), min_size=6, max_size=6))
@settings(max_examples=60, deadline=None)
def test_wild_boxes_do_no_harm(numbers):
    cx, cy, w, h, angle, heading = numbers
    box = replace(BOX, cx=cx, cy=cy, w=w, h=h, angle=angle, heading=heading, confidence=angle)
    assert draw(replace(SNAPSHOT, boxes=(box,), image=None), scale=0.25).shape == (180, 320, 3)


def test_a_number_of_a_box_without_a_name_and_an_id_in_doubt_share_no_mark():
    nobody = replace(BOX, system_id=0, number=11)
    guessed = replace(SNAPSHOT, vehicles=tuple(replace(row, standing="tentative") for row in SNAPSHOT.vehicles))
    texts = box_texts(guessed, BOX, ShownName(short="11", name="UGV-11", legend=""))
    assert "11?" in texts and label_of(SNAPSHOT, nobody) == "#11"
    assert label_of(SNAPSHOT, replace(nobody, number=0)) == "?"
    assert label_of(SNAPSHOT, replace(nobody, coasting=True)) == "~#11"
