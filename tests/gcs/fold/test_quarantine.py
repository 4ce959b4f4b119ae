"""A system id that two senders use names nobody: not in a snapshot, not in a row of the identity log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from assoc.records import Candidates, Identities
from gcs.fold.candidates import doubt_words
from gcs.fold.quarantine import limit_doubted, withhold_names
from gcs.session.identity_log import IdentityLog, read_identity
from mavlink.fleet.fleet import Fleet
from tests.support.fake_station import START_US, make_snapshot

CANDIDATES = replace(
    Candidates.empty(4),
    system_id=np.array([[11, 12], [12, 11], [11, 14], [13, 14]]),
    confidence=np.array([[0.97, 0.02], [0.99, 0.01], [0.1, 0.05], [0.91, 0.05]]),
    none_of_ours=np.array([0.01, 0.0, 0.8, 0.04]),
)
IDENTITIES = Identities(
    track_id=np.array([3, 4, 5, 6]),
    system_id=np.array([11, 12, 0, 13]),
    confidence=np.array([0.97, 0.99, 0.8, 0.91]),
    runner_up=np.array([12, 11, 11, 14]),
    runner_up_confidence=np.array([0.02, 0.01, 0.1, 0.05]),
    residual_m=np.array([0.4, 0.5, np.nan, 0.6]),
    position_age_s=np.array([0.1, 0.1, np.nan, 0.1]),
    projection=np.array([0.9, 0.9, np.nan, 0.9]),
    topology=np.array([0.9, 0.9, np.nan, 0.9]),
    fused=np.array([0.9, 0.9, np.nan, 0.9]),
    conflict=(),
    candidates=CANDIDATES,
    doubt=np.array([0, 0, 4, 0]),
)


def state_of(*contested, doubted=()):
    state = Fleet(1, (11, 12, 13)).at(START_US)
    vehicles = tuple(
        replace(each, contested=each.system_id in contested, doubted_for="no fix" * (each.system_id in doubted))
        for each in state.vehicles
    )
    return replace(state, vehicles=vehicles)


def test_contested_names_are_not_given():
    kept = withhold_names(IDENTITIES, state_of(12))
    assert kept.system_id.tolist() == [11, 0, 0, 13]
    assert kept.runner_up.tolist() == [0, 11, 11, 14]
    for name in ("confidence", "residual_m", "position_age_s", "projection", "topology", "fused"):
        before, after = getattr(IDENTITIES, name), getattr(kept, name)
        assert np.isnan(after[1])
        np.testing.assert_array_equal(np.delete(after, 1), np.delete(before, 1))


def test_nobody_is_named_while_the_cameras_own_id_is_contested():
    kept = withhold_names(IDENTITIES, state_of(1))
    assert not kept.system_id.any() and not kept.runner_up.any()
    assert kept.confidence[2] == IDENTITIES.confidence[2]


def test_what_a_vehicles_own_doubt_takes_goes_to_none_of_ours():
    told = limit_doubted(IDENTITIES, state_of(doubted=(12,)), 0.5)
    assert told.confidence.tolist() == [0.97, 0.75, 0.8, 0.91]
    before = IDENTITIES.candidates.confidence.sum(axis=1) + IDENTITIES.candidates.none_of_ours
    np.testing.assert_allclose(told.candidates.confidence.sum(axis=1) + told.candidates.none_of_ours, before)
    assert told.candidates.confidence[1].tolist() == [0.75, 0.01]


def test_doubts_are_told_of_answers_that_are_not_sure():
    told = withhold_names(limit_doubted(IDENTITIES, state_of(12, doubted=(13,)), 0.5), state_of(12))
    assert doubt_words(told) == [
        "",
        "several senders use its id",
        "vehicles have not driven like their boxes for long enough yet",
        "it doubts its own position",
    ]


def test_a_contradicted_name_is_not_given_and_why_is_told():
    told = withhold_names(IDENTITIES, state_of(), {13})
    assert told.system_id.tolist() == [11, 12, 0, 0]
    assert doubt_words(told)[3] == "its position contradicts the video"


@pytest.mark.parametrize("identities", [None, IDENTITIES])
def test_without_a_contest_nothing_changes(identities):
    assert withhold_names(identities, state_of()) is identities


def test_no_row_of_the_identity_log_carries_a_contested_name(tmp_path):
    kept = withhold_names(IDENTITIES, state_of(12))
    base = make_snapshot()
    boxes = tuple(
        replace(base.boxes[0], track_id=int(track), system_id=int(vehicle), confidence=float(sure), coasting=False)
        for track, vehicle, sure in zip(kept.track_id, kept.system_id, kept.confidence, strict=True)
    )
    with IdentityLog(tmp_path) as log:
        for frame in range(50):
            log.write(replace(base, frame=frame, boxes=boxes))
    rows = read_identity(tmp_path / "identity.csv")
    assert 12 not in rows["system_id"] and set(rows["system_id"][~np.isnan(rows["system_id"])]) == {11, 13}
