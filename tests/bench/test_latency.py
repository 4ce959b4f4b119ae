import pytest

from assoc.identification.identifier import Identifier
from bench.latency.stream import measure_streams, measure_waits, text_of, timed_parts
from vision.track.tracker import Tracker


@pytest.mark.slow
def test_tracker_and_identifier_are_timed_in_the_fold_and_left_as_they_were():
    before = Tracker.update, Identifier.update
    tracker, identifier, both = measure_streams(quick=True)
    assert (Tracker.update, Identifier.update) == before
    assert [t.method for t in (tracker, identifier, both)] == ["tracker", "identifier", "both"]
    assert tracker.calls == 30
    assert both.cpu_mean_ms == pytest.approx(tracker.cpu_mean_ms + identifier.cpu_mean_ms)
    assert min(tracker.cpu_mean_ms, identifier.cpu_mean_ms) > 0.0


def test_a_lap_is_what_was_spent_since_the_last_one():
    with timed_parts() as clock:
        answer = clock.around("adding", lambda a, b: a + b)(2, 3)
    assert answer == 5
    assert clock.lap("adding") > (0.0, 0.0)
    assert clock.lap("adding") == (0.0, 0.0)


@pytest.mark.slow
def test_frames_wait_longer_where_attitude_comes_seldom_and_never_beyond_the_bound():
    slow, *_, quick = rows = measure_waits(quick=True)
    assert all(row.frames == 30 for row in rows)
    assert 0.0 < quick.median_ms < slow.median_ms
    assert max(row.p95_ms for row in rows) <= 150.0
    assert slow.at_bound > 0.0
    assert text_of(rows).count("\n| ") == 1 + len(rows)
