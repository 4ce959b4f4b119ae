"""Each real change of a name is one event: a name near its limit comes and goes from frame to frame."""

from types import SimpleNamespace

import numpy as np
import pytest

from gcs.fold.name_changes import BACK_US, FADES_US, NameChanges
from gcs.mission.mission import Mission, MissionVehicle

STEP_US = 200_000
FADES, LASTS = FADES_US // STEP_US, BACK_US // STEP_US
"""Frames until it is told that a name is gone, and that it is back."""
MISSION = Mission(uav=MissionVehicle(system_id=1), ugv=tuple(MissionVehicle(system_id=i) for i in (11, 12)))
STATE = SimpleNamespace(
    vehicles=[
        SimpleNamespace(system_id=i, contested=False, position_state="ok", refused_for="", frozen=False)
        for i in (1, 11, 12)
    ]
)
SIZE = 640, 480


def told(*names):
    """Times in frames and words of the events, where each frame has the vehicles of tracks 3 and 4, 0 for no name."""
    changes, events = NameChanges(MISSION), []
    place = np.full(2, 200.0)
    tracks = SimpleNamespace(track_id=np.array([3, 4]), cx=place, cy=place, w=place / 10, h=place / 10)
    for frame, vehicles in enumerate(names):
        identities = SimpleNamespace(
            track_id=tracks.track_id,
            system_id=np.array(vehicles),
            confidence=np.full(2, 0.75),
            candidates=SimpleNamespace(none_of_ours=np.zeros(2)),
        )
        events += changes.update(frame * STEP_US, identities, STATE, tracks, SIZE)
    return [(event.t_us // STEP_US, event.text) for event in events]


NAMED, LOST = [(12, 0)], [(0, 0)]
IS, GONE = "track 3 is UGV-12 (75%)", "track 3 is no longer UGV-12: the evidence does not suffice"


def test_a_name_that_flickers_is_not_told_each_time():
    names = NAMED * 5 + LOST * 9 + NAMED * 7 + LOST * 2 + NAMED * 3 + LOST * 20 + NAMED * 30
    assert told(*names) == [(0, IS), (5 + FADES, GONE), (46 + LASTS, IS)]


def test_a_name_that_is_back_at_once_was_never_gone():
    assert told(*(NAMED * 5 + LOST * FADES) * 9, *NAMED) == [(0, IS)]


def test_a_name_that_lasts_is_told_and_so_is_its_next_loss():
    lasting, gone = NAMED * (LASTS + 1), LOST * (FADES + 1)
    end = len(lasting + gone)
    expected = [(0, IS), (LASTS + 1 + FADES, GONE), (end + LASTS, IS), (end + LASTS + 1 + FADES, GONE)]
    assert told(*lasting, *gone, *lasting, *gone) == expected


@pytest.mark.parametrize(
    ("later", "words"),
    [
        ([(0, 12)], "track 4 is UGV-12 (75%)"),
        ([(11, 0)], "track 3 is UGV-11 (75%)"),
    ],
)
def test_a_name_that_is_new_to_its_track_is_told_at_once(later, words):
    gone = LOST * (FADES + 1)
    assert told(*NAMED, *gone, *later) == [(0, IS), (1 + FADES, GONE), (1 + FADES + 1, words)]


def test_a_name_that_moves_is_told_of_its_new_track_alone():
    assert told(*NAMED, *LOST, *[(0, 12)] * 20) == [(0, IS), (2 + FADES, "track 4 is UGV-12 (75%)")]


def test_a_name_that_jumps_between_two_tracks_is_told_once():
    assert told(*NAMED * 3, *[(0, 12), (12, 0), (0, 12), (0, 12), (12, 0)] * 5) == [(0, IS)]


def test_one_sentence_has_who_is_it_now_and_who_no_longer():
    other = "track 3 is UGV-11 (75%), no longer UGV-12"
    assert told(*NAMED, *[(11, 0)] * 20) == [(0, IS), (1, other)]


def test_an_exchange_is_a_sentence_of_each_track():
    begin = [(0, "track 3 is UGV-12 (75%)"), (0, "track 4 is UGV-11 (75%)")]
    now = ["track 3 is UGV-11 (75%), no longer UGV-12", "track 4 is UGV-12 (75%), no longer UGV-11"]
    assert told((12, 11), *[(11, 12)] * 20) == [*begin, *((1 + FADES, each) for each in now)]
