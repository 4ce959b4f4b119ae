"""Looks in turns: the price of a frame is bounded, and nothing in the picture goes unseen for long."""

import numpy as np
import pytest

from tests.support.snapshots import boxes
from vision.detect.heatmap_detector import FRAME_PX
from vision.detect.turns import REACH_PX, LookInTurns

WIDTH, HEIGHT, T0, STEP_US = 1600, 900, 10**15, 100_000
PICTURE = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
LOW, HIGH = 0.4, 1.3
"""Scales at which the whole picture is within a frame's price, and four times as much."""


def NOBODY():  # noqa: N802 - a constant
    return {}


class Truth:
    """Sees the vehicles that are there, in what it looks at; in a coarse look only those that are clear."""

    frame_px, part_price = FRAME_PX, 1.3

    def __init__(self, centres=(), *, faint=()):
        self.centres, self.faint = np.array(centres, float).reshape(-1, 2), set(faint)
        self.spent_px, self.whole = 0.0, 0

    def scale(self, gsd_m):
        return gsd_m

    def detect(self, image, *, gsd_m=None):
        self.whole += 1
        return boxes(self.centres)

    def detect_in(self, image, parts, *, gsd_m):
        self.spent_px += sum((t.right - t.left) * (t.bottom - t.top) for t in parts) * gsd_m**2
        seen = [
            (x, y)
            for k, (x, y) in enumerate(self.centres.tolist())
            if (gsd_m == HIGH or k not in self.faint)
            and any(t.kept[0] <= x <= t.kept[2] and t.kept[1] <= y <= t.kept[3] for t in parts)
        ]
        return boxes(np.array(seen).reshape(-1, 2))


def film(truth, frames, move=(0.0, 0.0), reported=NOBODY, score=0.3, moved=None):
    """What is found in each frame, and its price."""
    look, found, centres = LookInTurns(truth, score), [], truth.centres
    truth.centres = centres[:0]  # they come once a first frame was looked at as a whole
    assert look.look(PICTURE, T0 - STEP_US, HIGH, reported=NOBODY).looked is None
    truth.centres = centres
    for k in range(frames):
        truth.spent_px = 0.0
        found.append((look.look(PICTURE, T0 + k * STEP_US, HIGH, moved=moved, reported=reported), truth.spent_px))
        truth.centres = truth.centres + move
    return found


def scattered(n, seed=1):
    return np.random.default_rng(seed).uniform((20, 20), (WIDTH - 20, HEIGHT - 20), (n, 2))


@pytest.mark.parametrize(("gsd_m", "turns"), [(None, False), (LOW, False), (HIGH, True)])
def test_a_picture_that_is_cheap_is_looked_at_as_a_whole(gsd_m, turns):
    truth = Truth(scattered(5))
    look = LookInTurns(truth, 0.3)
    first, found, late = (look.look(PICTURE, T0 + t_us, gsd_m, reported=NOBODY) for t_us in (0, STEP_US, 10**8))
    assert (found.looked is not None, truth.whole) == (turns, 2 if turns else 3)
    assert first.looked is late.looked is None and len(first) == len(late) == 5
    assert turns or found.looked_share((WIDTH, HEIGHT)) == 1.0


@pytest.mark.parametrize("n", [0, 1, 12, 60])
def test_no_frame_costs_more_than_its_price(n):
    # sides are rounded to whole pixels of the picture
    assert max(price for _, price in film(Truth(scattered(n)), 15)) < 1.03 * FRAME_PX / Truth.part_price


@pytest.mark.parametrize(("move", "n"), [((0.0, 0.0), 12), ((9.0, -4.0), 6)])
def test_all_are_found_within_a_second_and_again_within_half_a_second(move, n):
    truth = Truth(scattered(n))
    last = np.full(n, 0)
    for k, (found, _) in enumerate(film(truth, 40, move)):
        at = truth.centres - np.array(move) * (40 - k)
        near = np.hypot(*(at[:, None] - found.centre[None]).transpose(2, 0, 1)).min(axis=1, initial=np.inf) < 1.0
        inside = ((at > 0) & (at < (WIDTH, HEIGHT))).all(axis=1)
        last = np.where(near, k, last)
        if k >= 10:
            assert (k - last[inside]).max(initial=0) <= 5


def test_a_box_counts_only_where_somebody_looked():
    for found, _ in film(Truth(scattered(30)), 12):
        assert found.looked_at(found.centre).all()
        assert found.looked_share((WIDTH, HEIGHT)) < 1.0


def test_a_faint_one_is_found_where_it_reports_to_be():
    at = (777.0, 333.0)
    report = (at[0] + 20.0, at[1], 20.0)
    seen = {
        name: [len(found) for found, _ in film(Truth([at], faint=[0]), 12, reported=lambda r=r: r)]
        for name, r in {"silent": {}, "reports": {7: report}}.items()
    }
    assert not any(seen["silent"]) and all(seen["reports"][1:])


def test_the_places_follow_the_camera():
    shift = np.array([[1.0, 0.0, 1.5 * REACH_PX], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    seen = [len(found) for found, _ in film(Truth([[40.0, 400.0]]), 20, (1.5 * REACH_PX, 0.0), moved=shift)]
    assert all(seen[9:])


@pytest.mark.parametrize("n", [4, 12, 20])
def test_reports_where_nobody_is_take_no_turns_from_those_who_are_seen(n):
    truth = Truth(scattered(8, seed=3))
    alone = {k + 1: (*xy, 10.0) for k, xy in enumerate(scattered(n, seed=9).tolist())}
    look = LookInTurns(truth, 0.3)
    look.look(PICTURE, T0 - STEP_US, HIGH, reported=NOBODY)
    last, worst = np.zeros(8), 0
    for k in range(80):
        found = look.look(PICTURE, T0 + k * STEP_US, HIGH, reported=lambda: alone)
        near = np.hypot(*(truth.centres[:, None] - found.centre[None]).transpose(2, 0, 1)).min(axis=1, initial=np.inf)
        last = np.where(near < 1.0, k, last)
        worst = max(worst, int((k - last).max()))
    assert worst <= 10, "frames, a second"
    assert len(look._places) <= 8 + 2 * n


def test_reports_that_are_wrong_starve_nobody():
    reports = {k: (x, y, 60.0) for k, (x, y) in enumerate(scattered(20, seed=5).tolist())}
    seen = [len(found) for found, _ in film(Truth(scattered(4)), 25, reported=lambda: reports)]
    assert min(np.convolve(seen, np.ones(5))[14:25]) >= 4.0
