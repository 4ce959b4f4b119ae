"""What an operator states of a track is evidence: it decides what is open, and yields to reports that contradict it."""

import numpy as np
import pytest

from assoc.identification.identifier import Identifier
from assoc.records import VehicleReports
from tests.support.assoc_scene import Fleet, camera

IDS = (11, 12, 13, 14)
FPS = 10.0


class Filmed:
    """A fleet before an identifier, frame by frame; tracks are 1 … in the order of the vehicles."""

    def __init__(self, fleet, *, silent=(), hidden=()):
        self.fleet, self.silent, self.hidden = fleet, silent, hidden
        self.identifier = Identifier(IDS[: fleet.n])
        self.rng, self.t, self.heard = np.random.default_rng(1), 0.0, -1.0
        self.names = []

    def run(self, seconds):
        """Goes on; returns the names of the tracks in each frame."""
        said = []
        for _ in range(round(seconds * FPS)):
            reports = self.fleet.reports(self.heard, self.t, self.rng)
            kept = ~np.isin(reports.vehicle, self.silent)
            columns = {name: getattr(reports, name)[kept] for name in VehicleReports.__dataclass_fields__}
            self.heard = self.t
            tracks = np.arange(1, self.fleet.n + len(self.fleet.strangers) + 1)
            seen = self.fleet.observation(self.t, camera(), tracks, self.rng)
            rows = ~np.isin(tracks, self.hidden)
            seen = type(seen)(t_us=seen.t_us, **{k: getattr(seen, k)[rows] for k in PER_TRACK})
            self.last = self.identifier.update(seen, camera(), VehicleReports(**columns))
            said.append(dict(zip(self.last.track_id.tolist(), self.last.system_id.tolist(), strict=True)))
            self.t += 1.0 / FPS
        self.names += said
        return said


PER_TRACK = ("track_id", "ray_cam", "front_cam", "gap_s", "score")


@pytest.mark.slow
def test_a_vehicle_that_does_not_report_is_named_by_the_statement():
    filmed = Filmed(Fleet(n=3), silent=(1,))
    assert filmed.run(8)[-1] == {1: 11, 2: 0, 3: 13}
    filmed.identifier.state(2, 12)
    after = filmed.run(6)
    assert all(names == {1: 11, 2: 12, 3: 13} for names in after[1:])
    filmed.identifier.unstate(2)
    assert filmed.run(2)[-1] == {1: 11, 2: 0, 3: 13}


@pytest.mark.slow
def test_a_statement_counts_in_full_on_a_track_that_was_lost_before():
    filmed = Filmed(Fleet(n=3), silent=(1,))
    filmed.run(8)
    filmed.hidden = (2,)
    filmed.run(1.5)
    filmed.hidden = ()
    filmed.run(2)
    filmed.identifier.state(2, 12)
    assert filmed.run(2)[-1][2] == 12
    assert filmed.last.confidence[1] > 0.99


def test_a_right_statement_names_at_once():
    filmed = Filmed(Fleet(n=4))
    filmed.run(0.2)
    for track, vehicle in zip((1, 2, 3, 4), IDS, strict=True):
        filmed.identifier.state(track, vehicle)
    assert filmed.run(0.3)[-1] == {1: 11, 2: 12, 3: 13, 4: 14}
    assert filmed.run(10)[-1] == {1: 11, 2: 12, 3: 13, 4: 14}


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, 12.0])
def test_a_wrong_statement_costs_others_their_names_for_a_few_seconds_at_most(seconds):
    filmed = Filmed(Fleet(n=4))
    filmed.run(seconds)
    filmed.identifier.state(1, 13)
    wrong = [sum(vehicle not in (0, IDS[track - 1]) for track, vehicle in names.items()) for names in filmed.run(10)]
    assert sum(count > 0 for count in wrong) <= 4 * FPS
    assert filmed.names[-1] == {1: 11, 2: 12, 3: 13, 4: 14}


@pytest.mark.slow
def test_a_wrong_statement_of_a_vehicle_out_of_sight_yields_to_its_reports():
    filmed = Filmed(Fleet(n=4, spacing_m=14.0), hidden=(4,))
    filmed.run(10)
    filmed.identifier.state(1, 14)
    after = filmed.run(10)
    assert sum(names[1] == 14 for names in after) <= 5 * FPS
    assert after[-1] == {1: 11, 2: 12, 3: 13}


@pytest.mark.slow
def test_none_of_ours_takes_a_name_and_yields_when_the_track_moves_like_the_vehicle():
    filmed = Filmed(Fleet(n=3))
    filmed.run(10)
    filmed.identifier.state(2, 0)
    after = filmed.run(20)
    assert [names[2] for names in after[1:20]] == [0] * 19
    assert all(names[1] == 11 and names[3] == 13 for names in after)
    assert after[-1][2] == 12


@pytest.mark.slow
def test_a_stranger_that_was_named_stays_none_of_ours():
    filmed = Filmed(Fleet(n=3, strangers=((3.0, -20.0),)))
    filmed.run(6)
    filmed.identifier.state(4, 0)
    assert all(names[4] == 0 for names in filmed.run(10))


@pytest.mark.slow
def test_without_statements_nothing_changes():
    stated, plain = Filmed(Fleet(n=3)), Filmed(Fleet(n=3))
    stated.identifier.state(99, 12)
    stated.identifier.unstate(99)
    for _ in range(2):
        stated.run(2), plain.run(2)
    np.testing.assert_array_equal(stated.last.confidence, plain.last.confidence)


@pytest.mark.slow
def test_a_statement_holds_over_another_video():
    filmed = Filmed(Fleet(n=3), silent=(1,))
    filmed.run(5)
    filmed.identifier.state(2, 12)
    filmed.t = filmed.heard = 0.0
    assert filmed.run(3)[-1][2] == 12


def test_a_vehicle_that_there_is_not_cannot_be_stated():
    with pytest.raises(ValueError):
        Identifier(IDS).state(1, 99)
