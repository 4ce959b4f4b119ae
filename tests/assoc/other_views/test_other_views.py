"""Names across views: which boxes are one, and what is answered once a view has heard another one."""

import numpy as np
import pytest

from assoc.other_views.hearing import Hearing
from assoc.other_views.opinions import Hearsay, answers_for, information_of, pooled, without_taken
from assoc.other_views.same_boxes import SameBoxes, Shift, compared, places_at
from assoc.records import Sighting

GRID = np.stack(np.meshgrid([0.0, 4.0, 8.0], [0.0, 5.0]), axis=-1).reshape(-1, 2)
ROW = np.column_stack([4.0 * np.arange(5), np.zeros(5)])
SURE, EVEN = 0.97, np.full(4, 0.25)


def sighting(t_s, place, p=None, ids=None, fit=1.0):
    m = len(place)
    return Sighting(
        t_us=round(1e6 * t_s),
        track_id=np.arange(1, m + 1) if ids is None else np.array(ids),
        place=np.asarray(place, dtype=float),
        cov_m2=np.tile(0.25 * np.eye(2), (m, 1, 1)),
        common_std_m=1.5,
        p=np.tile(EVEN, (m, 1)) if p is None else np.asarray(p),
        fit=fit,
    )


def sure_of(*vehicles):
    return np.array([[SURE if k == vehicle else 0.01 for k in range(4)] for vehicle in vehicles])


@pytest.mark.parametrize(
    ("mine", "theirs", "pairs"),
    [
        (GRID + np.array([1.5, -1.2]), GRID, {k: k for k in range(6)}),  # a pose that is 2 m off
        (GRID[:3], GRID[2:5], {}),  # one box in common is no proof
        (GRID[:2], GRID[:2] + np.array([40.0, 0.0]), {}),  # elsewhere
        (np.full((2, 2), np.nan), GRID, {}),  # above the horizon
    ],
)
def test_boxes_are_paired_by_where_they_are(mine, theirs, pairs):
    rng = np.random.default_rng(1)
    seen = theirs + rng.normal(0.0, 0.2, theirs.shape)
    p, *_ = pairs_of(mine, seen, 4.5)
    assert {int(i): int(j) for i, j in np.argwhere(p > 0.8)} == pairs


def test_a_shift_that_was_sure_pairs_a_box_that_is_alone():
    _, shift, _ = pairs_of(GRID + np.array([1.5, -1.2]), GRID, 4.5)
    assert shift.mean == pytest.approx([1.5, -1.2], abs=0.2) and shift.cov[0, 0] < 0.2
    one, other = np.array([[31.5, -1.2]]), np.array([[30.0, 0.0]])
    assert pairs_of(one, other, 4.5)[0] < 0.8 < pairs_of(one, other, shift.cov[0, 0], shift.mean)[0]
    assert shift.after(2.0).cov - shift.cov == pytest.approx(np.eye(2))


def test_a_row_of_which_each_sees_another_part_is_not_paired_surely():
    p, *_ = pairs_of(ROW[:3] + np.array([2.0, 0.0]), ROW[1:4] - np.array([0.3, 0.0]), 18.0)
    assert np.max(p) < 0.9


def pairs_of(mine, theirs, shift_var, mean=(0.0, 0.0)):
    d = mine[:, None] - theirs[None]
    covs = np.tile(0.5 * np.eye(2), (*d.shape[:2], 1, 1))
    return compared(d, covs, Shift(np.array(mean), shift_var * np.eye(2)))


def test_a_track_goes_on_straight_for_half_a_second():
    looks = [sighting(0.1 * k, [[0.4 * k, 0.0]]) for k in range(11)]
    for after_s, found in ((0.3, [[5.2, 0.0]]), (0.6, [])):
        track, place, _ = places_at(round(1e6 * (1.0 + after_s)), looks)
        assert (track.tolist(), place.round(6).tolist()) == ([1] * len(found), found)


def test_answers_that_agree_prove_no_more_than_one_and_those_that_differ_nothing():
    one, other, none = sure_of(0), sure_of(1), EVEN[None]
    assert information_of(none)[0] == pytest.approx(0.0)
    both = [np.ones(1)] * 2
    for answers, same, fits, expected in (
        ([one, one], both, [1.0, 1.0], one),
        ([none, one], both, [1.0, 1.0], one),
        ([one, none], both, [1.0, 1.0], one),
        ([np.array([[0.55, 0.01, 0.01, 0.43]]), one], both, [1.0, 1.0], one),  # the same, less surely
        ([other, one], both, [0.0, 1.0], one),  # a film that does not fit
        ([one, other], both, [0.0, 0.0], one),
        ([none, one], [np.ones(1), np.full(1, 0.5)], [1.0, 1.0], 0.5 * none + 0.5 * one),  # perhaps another object
    ):
        assert pooled(answers, same, fits) == pytest.approx(expected, abs=1e-3)
    assert np.max(pooled([one, other], both, [1.0, 1.0])) < 0.5
    assert pooled([one, none], both, [1.0, 1.0]) is one


def test_who_is_named_elsewhere_is_no_other_box():
    before, after = np.tile(EVEN, (2, 1)), np.concatenate([sure_of(0), EVEN[None]])
    p = without_taken(before, after)
    assert p[0] == pytest.approx(after[0])
    assert p[1, 0] < 0.02 and p.sum(axis=1) == pytest.approx(1.0)
    said, same = answers_for(sure_of(0, 1), np.array([[0.5, 0.0], [0.0, 0.0]]))
    assert said == pytest.approx(np.concatenate([sure_of(0), EVEN[None]])) and same.tolist() == [0.5, 0.0]


def test_what_was_heard_fades():
    hearsay, ids, nothing = Hearsay(), np.array([7]), np.zeros(1)
    hearsay.update(0.0, ids, sure_of(2), np.ones(1))
    said, trust = hearsay.update(4.0, ids, EVEN[None], nothing)
    assert said == pytest.approx(sure_of(2)) and 0.5 < trust[0] < 0.7
    assert hearsay.update(40.0, ids, EVEN[None], nothing)[1].tolist() == [0.0]


def test_a_view_hears_a_name_and_tells_it_on_only_by_itself():
    told = [sighting(0.1 * k, GRID[:3], sure_of(0, 1, 2)) for k in range(10)]
    mine = sighting(1.0, GRID[:3] + 1.0, ids=[5, 6, 7])
    hearing = Hearing()
    p = hearing.answers(mine, {2: told})
    assert np.argmax(p, axis=1).tolist() == [0, 1, 2] and np.all(np.max(p, axis=1) > 0.8)
    assert np.array_equal(mine.p, np.tile(EVEN, (3, 1)))
    # gone from the other picture, it keeps the name for a while
    assert np.argmax(hearing.answers(sighting(2.5, GRID[:3] + 1.0, ids=[5, 6, 7]), {2: told}), axis=1)[0] == 0
    unfit = {2: [sighting(0.9, GRID[:3], sure_of(0, 1, 2), fit=0.0)]}
    assert np.array_equal(Hearing().answers(mine, unfit), mine.p)
    assert SameBoxes().update(mine, [])[1].shape == (3, 0)


@pytest.mark.parametrize(("gap_s", "named"), [(0.3, True), (0.5, True), (0.9, False)])
def test_a_name_goes_over_from_picture_to_picture(gap_s, named):
    """Three drive out of one picture; in the next one nothing tells who they are."""
    way, ids = np.array([3.0, 0.0]), [5, 6, 7]
    told = [sighting(0.1 * k, GRID[:3] + 0.1 * k * way, sure_of(0, 1, 2)) for k in range(11)]
    told += [sighting(1.1, np.empty((0, 2)), np.empty((0, 4)))]
    t_s = 1.0 + gap_s
    p = Hearing().answers(sighting(t_s, GRID[:3] + t_s * way + 0.5, ids=ids), {2: told})
    assert (np.argmax(p, axis=1).tolist() == [0, 1, 2] and np.min(np.max(p, axis=1)) > 0.8) == named


def test_of_three_views_the_one_that_knows_answers():
    knows, guesses = ([sighting(0.1 * k, GRID[:3], p) for k in range(10)] for p in (sure_of(0, 1, 2), None))
    mine, hearing = sighting(0.9, GRID[:3] - 1.0, sure_of(1, 1, 2), ids=[5, 6, 7], fit=0.2), Hearing()
    assert np.argmax(hearing.answers(mine, {2: guesses, 3: knows}), axis=1).tolist() == [0, 1, 2]
    assert not hearing.contradictions, "what does not fit contradicts nobody"
    sure = sighting(0.95, GRID[:3] - 1.0, sure_of(1, 1, 2), ids=[5, 6, 8])
    assert np.max(hearing.answers(sure, {2: guesses, 3: knows})[0]) < 0.8
    (difference,) = hearing.contradictions
    assert (difference.mine, difference.theirs, difference.view) == (1, 0, 3)
