"""Where the folds of several cameras meet: what each hears of the others, in its own world."""

from dataclasses import replace

import numpy as np
import pytest

from assoc.other_views.reconcile import Cause
from assoc.records import Sighting
from gcs.fold.view_exchange import ViewExchange, _words
from mavlink.geodesy import LocalFrame

HERE, THERE = LocalFrame(48.1, 11.6, 550.0), LocalFrame(48.1, 11.603, 540.0)
IDS, EVEN = (11, 12, 13), np.full((3, 4), 0.25)
SURE = np.array([[0.97, 0.01, 0.01, 0.01], [0.01, 0.97, 0.01, 0.01], [0.01, 0.01, 0.97, 0.01]])
PLACES = np.array([[5.0, 0.0, 0.0], [12.0, 3.0, 0.0], [20.0, -4.0, 0.0]])


def seen(t_us, origin, p):
    place = origin.to_enu(*HERE.to_geodetic(PLACES))[:, :2]
    return Sighting(
        t_us=t_us,
        track_id=np.arange(3),
        place=place,
        cov_m2=np.tile(0.25 * np.eye(2), (3, 1, 1)),
        common_std_m=1.5,
        p=p,
        fit=1.0,
    )


@pytest.mark.parametrize(
    ("heard", "fleet", "until"),
    [
        (None, IDS, 4),  # in flight the newest
        (lambda uav_id, frame: {2: 1} if uav_id == 1 else {}, IDS, 1),  # of a recording what it was in flight
        (lambda uav_id, frame: {}, IDS, None),
        (None, (11, 12, 14), 4),  # another fleet: heard, and of no use
    ],
)
def test_a_view_hears_another_one_in_its_own_world(heard, fleet, until):
    notes = []
    exchange = ViewExchange(heard)
    first, second = (exchange.join(k, lambda *note: notes.append(note)) for k in (1, 2))
    for frame in range(5):
        told = second.answers(frame, THERE, fleet, seen(100_000 * frame, THERE, SURE))
        assert np.array_equal(told, SURE), "nobody told it anything"
    assert exchange.newest(2) == 4 and not notes
    p = first.answers(9, HERE, IDS, seen(420_000, HERE, EVEN))
    assert notes == ([] if until is None else [(9, 2, until)])
    if until is None or fleet != IDS:
        assert np.array_equal(p, EVEN)
    else:
        assert np.argmax(p, axis=1).tolist() == [0, 1, 2] and np.min(np.max(p, axis=1)) > 0.8
    # what it heard it does not tell on
    assert np.array_equal(exchange.frames_of_others(2, 5)[1][-1].sighting.p, EVEN) if heard is None else True


def test_what_was_seen_elsewhere_is_not_the_same():
    exchange = ViewExchange()
    first, second = exchange.join(1), exchange.join(2)
    far = replace(seen(0, HERE, SURE), place=seen(0, HERE, SURE).place + 60.0)
    second.answers(0, HERE, IDS, far)
    assert np.allclose(first.answers(0, HERE, IDS, seen(0, HERE, EVEN)), EVEN)


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        (Cause("clock", 1.23), "a clock 1.2 s off"),
        (Cause("position", 5.6), "a camera 6 m from where it is said to be"),
        (Cause("camera", 0.2), "a camera turned by 11°"),
        (Cause("camera", 0.02, 0.8), "a scale 1.25 times off"),
    ],
)
def test_what_would_explain_a_contradiction_is_said(cause, words):
    assert _words(cause) == words
