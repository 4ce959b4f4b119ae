"""Names by the whole of a flight: broken tracks, look-alikes, errors that all share, and what cannot be told."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.params import IdentifierParams
from assoc.whole_flight.evidence import FlightEvidence
from assoc.whole_flight.linking import linked
from assoc.whole_flight.naming import segment_names
from tests.support.assoc_scene import T0_US, Fleet, camera

ZERO = np.zeros(9)
SECONDS = 20.0


def flown(
    fleet,
    *,
    ours=None,
    ids=lambda t, m: np.arange(1, m + 1),
    seen=lambda t, k: True,
    silent=lambda t, j: False,
    told=None,
    length_m=lambda t, k: np.nan,
    seconds=SECONDS,
):
    """Evidence of a flight in which the first ``ours`` vehicles report.

    Args:
        fleet: The world.
        ours: How many report; None: all.
        ids: Track ids at a time.
        seen: Whether an object has a box at a time.
        told: Camera as telemetry has it.
        length_m: How long the box of an object is at a time, metres.
        seconds: How long.
        silent: Whether a vehicle's report of a time is lost.
    """
    rng, ours = np.random.default_rng(5), fleet.n if ours is None else ours
    evidence = FlightEvidence(IdentifierParams())
    evidence.begin_anew(range(11, 11 + ours))
    m, heard = fleet.n + len(fleet.strangers), -1.0
    for k in range(int(seconds * 10)):
        t = k / 10
        every = fleet.reports(heard, t, rng)
        own = (every.vehicle < ours) & np.array([not silent(t, j) for j in every.vehicle.tolist()], bool)
        evidence.add_reports(replace(every, **{name: getattr(every, name)[own] for name in every.__slots__}))
        heard = t
        view = fleet.observation(t, camera(), ids(t, m), rng)
        shown = np.array([seen(t, k) for k in range(m)])
        view = replace(
            view,
            **{name: getattr(view, name)[shown] for name in ("track_id", "ray_cam", "front_cam", "gap_s", "score")},
            length_m=np.array([length_m(t, k) for k in range(m)])[shown],
        )
        evidence.add_frame(T0_US + round(t * 1e6), view, told or camera(), ZERO)
    return evidence


def probabilities(evidence, name=lambda at_us, track: -1, owner=None):
    """Segments and their probabilities; ``owner`` as a function of the segments."""
    segments = evidence.segments(T0_US, T0_US + round(1e6 * SECONDS), name)
    start = np.full(segments.seen.shape[1], -1) if owner is None else owner(segments)
    names = segment_names(segments, evidence.params, start)
    return names.segments, names.p


def named(segments, p, t, track):
    """Vehicle of a box if its probability is 0.9, −1 none of ours, None unknown."""
    row = p[segments.of[T0_US + round(t * 1e6), track]]
    best = int(np.argmax(row))
    return None if row[best] < 0.9 else best if best < len(row) - 1 else -1


def test_all_are_named_from_their_first_box_on_though_nobody_was_known():
    segments, p = probabilities(flown(Fleet(4, seed=1)))
    assert [named(segments, p, 0.0, track) for track in (1, 2, 3, 4)] == [0, 1, 2, 3]


def test_a_stranger_that_drives_on_its_own_is_none_of_ours():
    segments, p = probabilities(flown(Fleet(5, seed=2), ours=4))
    assert [named(segments, p, 5.0, track) for track in range(1, 6)] == [0, 1, 2, 3, -1]


def test_pieces_of_broken_tracks_have_the_name_of_the_whole():
    """Each track ends every four seconds, and all are out of sight for 0.9 s."""

    def ids(t, m):
        return np.arange(1, m + 1) + 100 * int(t // 4.0)

    evidence = flown(Fleet(4, seed=3, bias_m=1.0), ids=ids, seen=lambda t, k: t % 4.0 < 3.1)
    segments, p = probabilities(evidence)
    for piece in range(5):
        names = [named(segments, p, 4.0 * piece + 1.0, track + 100 * piece) for track in (1, 2, 3, 4)]
        assert names == [0, 1, 2, 3]


def test_a_wrong_heading_and_place_of_the_camera_are_found():
    told = camera(p=(1.5, -1.0, 41.0), yaw=np.deg2rad(6.0))
    segments, p = probabilities(flown(Fleet(5, seed=4, bias_m=0.8), told=told))
    assert [named(segments, p, 10.0, track) for track in range(1, 6)] == [0, 1, 2, 3, 4]


def test_a_wrong_start_is_overcome():
    evidence = flown(Fleet(4, seed=1))
    segments, p = probabilities(evidence, owner=lambda found: np.array([1, 0, 2, 3])[: found.seen.shape[1]])
    assert [named(segments, p, 5.0, track) for track in (1, 2, 3, 4)] == [0, 1, 2, 3]


def broken_at_ten_s(t, m):
    return np.arange(1, m + 1) + 100 * int(t >= 10.0)


def alike(*, apart_m, bias_m=0.0, n=4):
    """Vehicles of which the first two drive side by side; errors of the two towards each other."""
    fleet = Fleet(n, seed=1, bias_m=0.1)
    fleet.phase[1], fleet.size[1] = fleet.phase[0], fleet.size[0]
    fleet.start[1] = fleet.start[0] + [apart_m, 0.0]
    fleet.bias[:2] = [bias_m, 0.0], [-bias_m, 0.0]
    return fleet


def test_names_that_change_sides_halfway_do_not_change_for_ever():
    evidence = flown(alike(apart_m=4.0), ids=broken_at_ten_s, seen=lambda t, k: not 9.0 <= t < 10.0)

    def crossed(found):
        owner = np.full(found.seen.shape[1], -1)
        for track, vehicle in zip((1, 2, 3, 4, 101, 102, 103, 104), (0, 1, 2, 3, 1, 0, 2, 3), strict=True):
            owner[found.of[T0_US + (12_000_000 if track > 100 else 0), track]] = vehicle
        return owner

    segments, p = probabilities(evidence, owner=crossed)
    assert [named(segments, p, 5.0, track) for track in (1, 2, 3, 4)] == [0, 1, 2, 3]
    assert [named(segments, p, 15.0, track) for track in (101, 102, 103, 104)] == [0, 1, 2, 3]


def test_two_that_could_be_taken_for_one_another_for_the_whole_flight_are_not_sure():
    """Their errors put each report nearly where the other is; each piece fits the other pieces of its vehicle."""
    evidence = flown(alike(apart_m=3.0, bias_m=1.6), ids=broken_at_ten_s, seen=lambda t, k: not 9.0 <= t < 10.0)
    segments, p = probabilities(evidence)
    for t, tracks in ((5.0, (1, 2)), (15.0, (101, 102))):
        assert [named(segments, p, t, track) for track in tracks] == [None, None]
        both = p[[segments.of[T0_US + round(t * 1e6), track] for track in tracks]][:, :2]
        assert np.all(np.sum(both, axis=1) > 0.95)
    assert [named(segments, p, 5.0, track) for track in (3, 4)] == [2, 3]


@pytest.mark.parametrize(
    ("apart_m", "without_s", "length_m", "sure"),
    [
        (2.0, 6.0, np.nan, False),
        (4.0, 6.0, np.nan, True),
        (2.0, 2.0, np.nan, True),
        (4.0, 6.0, 9.0, False),
        (4.0, 6.0, 6.0, True),
    ],
)
def test_a_box_in_which_another_vehicle_is_for_long_has_no_sure_name(apart_m, without_s, length_m, sure):
    def since_it_was_apart(t, k):
        return k != 1 or not 4.0 <= t < 4.0 + without_s

    evidence = flown(alike(apart_m=apart_m), seen=since_it_was_apart, length_m=lambda t, k: length_m)
    segments = evidence.segments(T0_US, T0_US + round(1e6 * SECONDS), lambda at_us, track: -1)
    names = segment_names(segments, evidence.params, np.full(segments.seen.shape[1], -1))

    def of(track, t):
        t_us = T0_US + round(1e6 * t)
        return names.with_another(names.at(t_us, track), t_us, track)

    p = {t: of(1, t) for t in (2.0, 5.0, 12.0)}
    assert min(p[2.0][0], p[12.0][0]) > 0.95
    assert (p[5.0][0] > 0.95) == sure
    assert sure or p[5.0][1] > 0.45
    assert of(3, 5.0)[2] > 0.95, "the others are as sure as ever"


@pytest.mark.parametrize(("off_m", "sure"), [(5.0, False), (2.5, True)])
def test_a_track_far_off_where_all_others_are_right_may_be_a_stranger_that_drives_alike(off_m, sure):
    fleet = Fleet(4, seed=1, bias_m=0.1)
    fleet.bias[3] = [off_m, 0.0]
    evidence = flown(fleet)
    segments = evidence.segments(T0_US, T0_US + round(1e6 * SECONDS), lambda at_us, track: -1)
    names = segment_names(segments, evidence.params, np.full(segments.seen.shape[1], -1))
    t_us = T0_US + 5_000_000
    told = [names.with_another(names.at(t_us, track), t_us, track) for track in (1, 2, 3, 4)]
    assert (told[3][3] > 0.9) == sure and (sure or told[3][-1] > 0.4)
    assert np.diagonal(told[:3]).min() > 0.9, "the others are as sure as ever"


@pytest.mark.parametrize(("exchanged_s", "bias_m"), [(10.0, 0.0), (15.0, 0.0), (16.0, 0.5), (17.0, 0.5)])
def test_tracks_that_were_exchanged_before_anybody_was_named_have_two_names_each(exchanged_s, bias_m):
    """Also where one of the two tells later than the other, or not at all."""

    def exchanged(t, m):
        return np.arange(1, m + 1) if t < exchanged_s else np.array([2, 1, *range(3, m + 1)])

    segments, p = probabilities(flown(alike(apart_m=3.0, bias_m=bias_m), ids=exchanged))
    assert [named(segments, p, exchanged_s - 5.0, track) for track in (1, 2, 3, 4)] == [0, 1, 2, 3]
    assert [named(segments, p, exchanged_s + 1.5, track) for track in (1, 2, 3, 4)] == [1, 0, 2, 3]


def test_a_track_that_goes_on_with_a_stranger_is_cut_there():
    """The first vehicle is missed from 9 s on for the rest of the flight; its track takes a stranger's boxes."""

    def taken_over(t, m):
        return np.array([1, 2, 3, 4, 5 if t < 10.0 else 1])

    fleet = Fleet(5, seed=2)
    segments, p = probabilities(flown(fleet, ours=4, ids=taken_over, seen=lambda t, k: k != 0 or t < 9.9))
    assert [named(segments, p, 5.0, track) for track in range(1, 6)] == [0, 1, 2, 3, -1]
    assert [named(segments, p, 15.0, track) for track in range(1, 5)] == [-1, 1, 2, 3]


def test_a_short_track_has_its_name_though_it_begins_with_another_object():
    def taken_over(t, m):
        return np.array([1, 2, 3, 4, 5 if t >= 3.0 else 1])

    def seen(t, k):
        return 3.0 <= t < 8.0 if k == 0 else True

    segments, p = probabilities(flown(Fleet(5, seed=2), ours=4, ids=taken_over, seen=seen))
    assert named(segments, p, 6.0, 1) == 0


def test_a_name_does_not_outlast_its_vehicles_reports_by_much():
    """The first vehicle falls silent after 8 s; its track may have gone on with another one since."""
    evidence = flown(Fleet(4, seed=6), silent=lambda t, j: j == 0 and t > 8.0)
    segments = evidence.segments(T0_US, T0_US + 20_000_000, lambda at_us, track: -1)
    names = segment_names(segments, evidence.params, np.full(segments.seen.shape[1], -1))
    assert names.at(T0_US + 9_000_000, 1)[0] > 0.9
    assert names.at(T0_US + 15_000_000, 1) is None
    assert names.at(T0_US + 15_000_000, 2)[1] > 0.9


def test_of_two_that_report_one_place_neither_is_sure():
    fleet = Fleet(4, seed=7)
    evidence = FlightEvidence(IdentifierParams())
    evidence.begin_anew((11, 12, 13, 14, 15))
    rng, heard = np.random.default_rng(1), -1.0
    for k in range(150):
        t = k / 10
        reports = fleet.reports(heard, t, rng)
        first = reports.vehicle == 0
        copied = replace(reports, **{name: getattr(reports, name)[first] for name in reports.__slots__})
        evidence.add_reports(reports)
        evidence.add_reports(replace(copied, vehicle=np.full(len(copied.vehicle), 4)))
        heard = t
        view = fleet.observation(t, camera(), [1, 2, 3, 4], rng)
        evidence.add_frame(T0_US + round(t * 1e6), view, camera(), ZERO)
    segments, p = probabilities(evidence)
    assert [named(segments, p, 5.0, track) for track in (2, 3, 4)] == [1, 2, 3]
    assert np.max(p[segments.of[T0_US + 5_000_000, 1], :-1]) < 0.7


def test_a_track_is_cut_where_its_name_changes():
    evidence = flown(Fleet(2, seed=8))
    known = evidence.segments(T0_US, T0_US + 20_000_000, lambda at_us, track: int(at_us > T0_US + 9_000_000))
    assert known.of[T0_US, 1] != known.of[T0_US + 10_000_000, 1]
    whole = evidence.segments(T0_US, T0_US + 20_000_000, lambda at_us, track: -1)
    assert whole.of[T0_US, 1] == whole.of[T0_US + 10_000_000, 1]


def test_pieces_are_joined_where_only_one_can_go_on():
    def ids(t, m):
        return np.arange(1, m + 1) + 100 * int(t >= 5.0)

    calm = Fleet(3, seed=9)
    calm.size[:] = 1.5
    evidence = flown(calm, ids=ids, seen=lambda t, k: not 5.0 <= t < 6.0, seconds=10.0)
    segments = evidence.segments(T0_US, T0_US + 10_000_000, lambda at_us, track: -1)
    for track in (1, 2, 3):
        assert segments.of[T0_US, track] == segments.of[T0_US + 8_000_000, track + 100]


def test_pieces_that_two_could_go_on_in_are_not_joined():
    def ids(t, m):
        return np.arange(1, m + 1) + 100 * int(t >= 5.0)

    close = Fleet(2, seed=9, spacing_m=0.8)
    close.phase[:], close.size[:], close.start[:, 1] = 0.0, 3.0, 0.0
    evidence = flown(close, ids=ids, seen=lambda t, k: not 5.0 <= t < 6.0, seconds=10.0)
    segments = evidence.segments(T0_US, T0_US + 10_000_000, lambda at_us, track: -1)
    assert len({segments.of[T0_US, 1], segments.of[T0_US + 8_000_000, 101], segments.of[T0_US + 8_000_000, 102]}) == 3
    n = segments.seen.shape[1]
    assert linked(segments.history, ZERO, np.full(n, -1)).tolist() == list(range(n))


@pytest.mark.parametrize("change", [{"attitude_known": False}, {"ground_z": np.nan}])
def test_frames_without_a_pose_tell_nothing(change):
    evidence, rng = FlightEvidence(IdentifierParams()), np.random.default_rng(0)
    evidence.begin_anew((11, 12))
    for k in range(20):
        view = Fleet(2).observation(k / 10, camera(), [1, 2], rng)
        evidence.add_frame(T0_US + k * 100_000, view, replace(camera(), **change), ZERO)
    assert evidence.segments(T0_US, T0_US + 2_000_000, lambda at_us, track: -1) is None


def test_what_is_forgotten_is_gone_and_the_rest_stays():
    evidence = flown(Fleet(2, seed=8))
    evidence.forget(T0_US + 10_000_000)
    segments = evidence.segments(T0_US, T0_US + 20_000_000, lambda at_us, track: -1)
    assert min(at_us for at_us, _ in segments.of) == T0_US + 10_000_000
    evidence.begin_anew((11, 12))
    assert evidence.segments(T0_US, T0_US + 20_000_000, lambda at_us, track: -1) is None


def test_what_was_reported_long_after_a_stretch_takes_nothing_from_it():
    fleet = Fleet(4, seed=1)
    evidence, rng = flown(fleet), np.random.default_rng(2)
    for t in np.arange(SECONDS, 200.0, 10.0).tolist():
        evidence.add_reports(fleet.reports(t, t + 10.0, rng))
    segments, p = probabilities(evidence)
    assert [named(segments, p, 0.0, track) for track in (1, 2, 3, 4)] == [0, 1, 2, 3]
