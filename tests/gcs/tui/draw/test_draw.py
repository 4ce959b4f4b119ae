from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gcs.tui import playback
from gcs.tui.draw.braille import BrailleCanvas
from gcs.tui.draw.cell_grid import CellGrid
from gcs.tui.draw.format import age, clock, degrees, duration, metres, number, position
from gcs.tui.draw.ground_view import map_view_of, points_of, scale_bar, step_scale
from gcs.tui.draw.map_canvas import chart_cells
from gcs.tui.draw.mosaic import HALF, Mosaic, fit
from gcs.tui.draw.pane_layout import PANES, LayoutState, arranged
from gcs.tui.draw.strips import bar, fitted, line
from gcs.tui.draw.video_canvas import box_at, video_cells
from gcs.tui.panes.fleet import columns_for
from gcs.tui.screens.saving import save_new
from infra.plain_text import plain
from tests.support.fake_station import START_US, STOP_US, FakeTimeline, make_events, make_snapshot

SNAPSHOT = make_snapshot()
INK = 0xFF0000


def text_of(cells: CellGrid) -> list[str]:
    return [strip.text for strip in cells.strips()]


@given(st.text())
@settings(max_examples=60, deadline=None)
def test_plain_text_is_one_line_without_control(text):
    said = plain(text)
    assert len(said) == len(text)
    assert said.isprintable() or all(letter.isprintable() or letter.isspace() for letter in said)
    assert not any(ord(letter) < 32 or 0x7F <= ord(letter) < 0xA0 for letter in said)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.04, "0.0s"), (9.96, "10s"), (99.6, "2m"), (3600.0, "60m"), (7200.0, "2h"), (math.inf, "never"), (math.nan, "–"),
     (-0.3, "0.0s")],
)  # fmt: skip
def test_ages(seconds, said):
    assert age(seconds) == said


def test_states_of_a_position_are_words():
    assert position("ok", 0.2) == "0.2s"
    assert position("stale", 1.4) == "stale 1s"
    assert position("lost", 12.0) == "lost 12s"
    assert position("never", math.inf) == "never"
    assert position("refused", 3.0) == "refused"
    assert position("same", 12.0) == "same 12s"


def test_times_and_numbers():
    assert clock(START_US + 480_000, tenths=True) == "10:33:12.4Z"
    assert clock(2**62) == "--:--:--"
    assert duration(3723) == "1:02:03" and duration(-5) == "-00:05" and duration(59.9) == "00:59"
    assert degrees(-math.pi / 2) == "270°" and degrees(math.nan) == "–" and degrees(2 * math.pi - 1e-9) == "000°"
    assert [metres(m) for m in (0.44, 99.9, 234.8, 7905, 25_000)] == ["0.4 m", "99.9 m", "235 m", "7.9 km", "25 km"]
    assert metres(math.nan) == "–"


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90", 90), ("1:30", 90), ("1:02:03", 3723), ("0.5", 0.5), ("+10", 110), ("-1:00", 40), (" 50% ", 377),
     ("10:33:42Z", 30), ("10:34z", 48)],
)  # fmt: skip
def test_times_that_operators_type(text, seconds):
    goal = playback.parse_time(text, START_US, STOP_US, START_US + 100_000_000)
    assert (goal - START_US) / 1e6 == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "soon", "1:2:3:4", "12:00:00Z", "99:99:99Z", "١٠", "--5", "1e3", "%", "nan"])
def test_times_that_mean_nothing_are_refused(text):
    with pytest.raises(ValueError, match=r"time"):
        playback.parse_time(text, START_US, STOP_US, START_US)


def test_a_clock_time_past_midnight_is_the_next_day():
    start = START_US + 13 * 3600 * 1_000_000  # 23:33:12
    assert playback.parse_time("00:10:00Z", start, start + 3600 * 1_000_000, start) == start + 2208 * 1_000_000


def test_events_beside_now():
    timeline = FakeTimeline()
    timeline.now_us = START_US + 130_000_000
    times_us = [event.t_us for event in make_events()]
    assert playback.time_beside(times_us, timeline, 1) == START_US + 180_400_000
    assert playback.time_beside(times_us, timeline, -1) == START_US + 95_200_000
    assert playback.time_beside([], timeline, 1) is None


@given(
    width=st.integers(1, 260), height=st.integers(1, 90), layout=st.sampled_from([1, 2, 3]),
    toggled=st.frozensets(st.sampled_from(PANES)), rows=st.integers(1, 60), aspect=st.floats(0.3, 4.0),
)  # fmt: skip
@settings(max_examples=300, deadline=None)
def test_panes_never_overlap_and_stay_inside(width, height, layout, toggled, rows, aspect):
    state = LayoutState(layout=layout, toggled=toggled, fleet_rows=rows, aspect=aspect)
    rects = arranged(width, height, state)
    assert set(rects) <= state.shown(width, height)
    for x, y, w, h in rects.values():
        assert x >= 0 and y >= 0 and x + w <= width and y + h <= height
        assert w >= 0 and h >= 0
    for (ax, ay, aw, ah), (bx, by, bw, bh) in combinations(rects.values(), 2):
        assert ax + aw <= bx or bx + bw <= ax or ay + ah <= by or by + bh <= ay


@pytest.mark.parametrize("layout", [1, 2, 3])
def test_small_screen_wastes_no_row(layout):
    rects = arranged(80, 22, LayoutState(layout=layout))
    assert max(y + h for _, y, _, h in rects.values()) == 22
    assert rects["fleet"][3] >= 9  # the whole fleet of eight


def test_columns_come_by_rank():
    assert [column.title for column in columns_for(31)] == ["NAME", "IDENTITY", "LINK"]
    wide = [column.title for column in columns_for(120)]
    assert wide[:4] == ["ID", "NAME", "IDENTITY", "LINK"] and len(wide) == 13
    for width in range(31, 130):
        columns = columns_for(width)
        assert sum(column.width for column in columns) + len(columns) <= width


def test_strips_have_an_exact_width():
    assert fitted("漢字漢字", 5) == "漢字…" and fitted("ab", 4, "right") == "  ab"
    assert line([("漢字漢字", columns_style())], 5).cell_length == 5
    assert bar(0.5, 4) == "██  " and bar(math.nan, 3) == "   " and bar(7.0, 3) == "███"


def columns_style():
    from gcs.tui.palette import ink

    return ink()


def test_a_line_of_dots_is_a_braille_line():
    dots = BrailleCanvas(3, 1)
    dots.line(np.array([0.0, 0.0]), np.array([5.0, 0.0]), INK)
    assert [chr(0x2800 + bits) for bits in dots.bits[0]] == ["⠉", "⠉", "⠉"]


@given(st.lists(st.floats(-1e9, 1e9), min_size=4, max_size=4))
@settings(max_examples=60, deadline=None)
def test_lines_from_anywhere_stay_in_the_grid(ends):
    dots = BrailleCanvas(10, 5)
    dots.line(np.array(ends[:2]), np.array(ends[2:]), INK)
    dots.circles(np.array([ends[:2]]), np.abs(ends[2:3]), INK)
    assert dots.bits.shape == (5, 10) and dots.bits.max() < 256


def test_cells_become_strips_of_equal_neighbours():
    cells = CellGrid(6, 2, 0)
    cells.picture(Mosaic(np.full((1, 4), HALF), np.full((1, 4), INK), np.zeros((1, 4), dtype=int)), 1, 0)
    cells.text(4, 1, "漢x", INK)
    strips = cells.strips()
    assert [strip.text for strip in strips] == [" ▀▀▀▀ ", "    ·x"]
    assert [strip.cell_length for strip in strips] == [6, 6]
    assert len(strips[0]._segments) == 3


def test_lines_that_are_drawn_at_once_are_as_if_drawn_one_after_the_other():
    rng = np.random.default_rng(4)
    ends, inks = rng.uniform(-20, 120, (40, 4)), rng.integers(1, 1 << 24, 40)
    together, singly = BrailleCanvas(30, 15), BrailleCanvas(30, 15)
    for k, (*start, x, y) in enumerate(ends):
        together.line(np.array(start), np.array([x, y]), int(inks[k]))
        singly.line(np.array(start), np.array([x, y]), int(inks[k]))
        _ = singly.bits  # draws what waits
        if k == 20:
            for dots in (together, singly):
                dots.circles(np.array([[30.0, 30.0]]), np.array([9.0]), INK)
    assert (together.bits == singly.bits).all() and (together.ink == singly.ink).all()


@pytest.mark.parametrize(("columns", "rows"), [(160, 45), (80, 24), (10, 40), (1, 1), (200, 3)])
def test_images_keep_their_shape(columns, rows):
    left, top, wide, high = fit(1280, 720, columns, rows)
    assert left + wide <= columns and top + high <= rows and wide >= 1 and high >= 1
    if min(wide, high) > 8:
        assert wide / (2 * high) == pytest.approx(16 / 9, rel=0.1)


def test_names_stand_on_the_image_and_boxes_can_be_found_again():
    rows = text_of(video_cells(SNAPSHOT, 12, 100, 29))
    for label in ("UGV-11 97%", "UGV-12 99%", "UGV-13? 61%", "~UGV-14 88%"):
        assert any(label in row for row in rows), label
    _, top, columns, _ = fit(1280, 720, 100, 29)
    for box in SNAPSHOT.boxes:
        x, y = int(box.cx * columns / 1280), int(top + box.cy * columns / 2560)
        assert box_at(SNAPSHOT, x, y, 100, 29) is box
    assert box_at(SNAPSHOT, 50, 26, 100, 29) is None


def test_a_speck_of_a_box_is_still_seen():
    tiny = replace(SNAPSHOT.boxes[4], w=2.0, h=1.0, heading=math.nan)
    rows = text_of(video_cells(replace(SNAPSHOT, image=None, boxes=(tiny,)), 0, 40, 12))
    assert sum(0x2800 < ord(letter) <= 0x28FF for row in rows for letter in row) >= 3


def test_the_map_holds_everybody_with_north_up():
    view = map_view_of(points_of(SNAPSHOT), 60, 20)
    rows = text_of(chart_cells(SNAPSHOT, 0, view))
    for word in ("UAV", "UGV-11", "UGV-12", "UGV-13 stale", "UGV-14", "UGV-15", "UGV-16", "?", "◆", "N↑", " m"):
        assert any(word in row for row in rows), word
    at = {name: next(y for y, row in enumerate(rows) if name in row) for name in ("UGV-16", "UGV-14")}
    assert at["UGV-16"] < at["UGV-14"]  # 21 m north against 5 m south


@given(
    st.lists(st.tuples(st.floats(-5e3, 5e3), st.floats(-5e3, 5e3)), max_size=8),
    st.integers(20, 200),
    st.integers(8, 60),
)
@settings(max_examples=80, deadline=None)
def test_a_fitting_view_holds_all_points(points, columns, rows):
    places = np.array(points, dtype=float).reshape(-1, 2)
    view = map_view_of(places, columns, rows)
    dots = view.dots(places)
    assert ((dots >= 0) & (dots <= (2 * columns, 4 * rows))).all()
    assert dots.shape == places.shape


def test_view_keeps_its_scale_while_it_fits():
    points = np.array([[-20.0, -10.0], [20.0, 10.0]])
    first = map_view_of(points, 60, 20)
    assert map_view_of(points * 0.9, 60, 20, before=first.metres_per_dot).metres_per_dot == first.metres_per_dot
    assert map_view_of(points * 0.2, 60, 20, before=first.metres_per_dot).metres_per_dot < first.metres_per_dot


def test_scales_step_there_and_back():
    for scale in (0.1, 0.28, 1.0, 5.6, 40.0):
        assert step_scale(step_scale(scale, 3), -3) == pytest.approx(scale)
    assert step_scale(0.01, -5) == pytest.approx(0.01)


@example(4999.999999999999, 10)
@given(st.floats(0.01, 5000), st.integers(4, 60))
@settings(max_examples=60, deadline=None)
def test_scale_bar_says_its_own_length(metres_per_dot, longest):
    text, metres = scale_bar(metres_per_dot, longest)
    cells = text.index("┤") + 1
    assert cells <= longest and cells * 2 * metres_per_dot == pytest.approx(metres, abs=2.5 * metres_per_dot)


def test_nothing_is_saved_over_a_file(tmp_path):
    goal = tmp_path / "a.svg"
    assert save_new(str(goal), b"one") == goal
    with pytest.raises(ValueError, match="exists"):
        save_new(str(goal), b"two")
    assert goal.read_text() == "one"
    with pytest.raises(ValueError, match="needed"):
        save_new("  ", b"x")


@pytest.mark.parametrize(("width", "height"), [(120, 37), (160, 45), (200, 57), (200, 62)])
def test_a_map_never_takes_rows_of_a_table_that_has_too_few(width, height):
    few, many = (arranged(width, height, LayoutState(fleet_rows=count)) for count in (8, 41))
    assert "map" in few and ("map" in many) is (height == 62)
    assert many["fleet"][3] == min(42, height - 6)
    assert "map" in arranged(width, height, LayoutState(fleet_rows=41, layout=2))
    assert arranged(width, height, LayoutState(fleet_rows=41, maximised="map"))["map"][3] == height


def test_a_height_of_nothing_has_no_sign():
    assert (number(-0.3, "m", 0), number(-0.04, "m"), number(-0.6, "m", 0)) == ("0 m", "0.0 m", "-1 m")
