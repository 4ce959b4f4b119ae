import pytest

from assoc.identification.identifier import Identifier
from bench.latency import measure_streams, timed_parts
from vision.track.tracker import Tracker


@pytest.mark.slow
def test_tracker_and_identifier_are_timed_in_the_fold_and_left_as_they_were():
    before = Tracker.update, Identifier.update
    tracker, identifier, both = measure_streams(quick=True)
    assert (Tracker.update, Identifier.update) == before
    assert [t.part for t in (tracker, identifier, both)] == ["tracker", "identifier", "both"]
    assert tracker.frames == 30
    assert both.cpu_mean_ms == pytest.approx(tracker.cpu_mean_ms + identifier.cpu_mean_ms)
    assert min(tracker.cpu_mean_ms, identifier.cpu_mean_ms) > 0.0


def test_a_lap_is_what_was_spent_since_the_last_one():
    with timed_parts() as clock:
        answer = clock.around("adding", lambda a, b: a + b)(2, 3)
    assert answer == 5
    assert clock.lap("adding") > (0.0, 0.0)
    assert clock.lap("adding") == (0.0, 0.0)
