"""What the operator stated is read from ``events.jsonl`` as it was written; a line that cannot be right is skipped."""

from __future__ import annotations

import json
import math

import pytest

from gcs.session.event_log import event_row, read_changes, read_events, read_statements
from gcs.snapshot import Event, FleetChange, Statement

STATED = Statement(track_id=7, system_id=12, frame=40, cx=100.25, cy=50.5)
NONE = Statement(track_id=9, system_id=0, frame=41, cx=1.0, cy=2.0)
UNDONE = Statement(track_id=7, system_id=12, frame=60, cx=100.25, cy=50.5, undone=True)


def line(statement=None, **change):
    event = Event(t_us=1, level="info", kind="operator", text="x", system_id=12, statement=statement)
    row = json.loads(event_row(event))
    return json.dumps(row | ({"statement": row["statement"] | change} if change else {}))


def test_statements_come_back_in_their_order(tmp_path):
    (tmp_path / "events.jsonl").write_text("\n".join([line(STATED), line(), line(NONE), line(UNDONE)]) + "\n")
    assert read_statements(tmp_path, (11, 12)) == [STATED, NONE, UNDONE]
    assert read_statements(tmp_path, (11,)) == [NONE]


def test_events_without_a_statement_are_written_as_before():
    assert set(json.loads(line())) == {"time_us", "level", "kind", "system_id", "text"}


@pytest.mark.parametrize(
    "change",
    [
        {"track_id": 0},
        {"track_id": "7"},
        {"frame": -1},
        {"system_id": 256},
        {"cx": 1e12},
        {"frame": 1 << 40},
        {"cy": "a"},
    ],
)
def test_a_line_that_cannot_be_right_is_counted_and_skipped(tmp_path, change):
    path = tmp_path / "events.jsonl"
    path.write_text(line(STATED, **change) + "\n" + line(NONE) + "\n")
    assert read_statements(tmp_path, (11, 12)) == [NONE]
    assert read_events(path)[1] == 1


ADDED = FleetChange(what="added", system_id=18, name="[b]Eve", t_us=5, frame=7)


@pytest.mark.parametrize(
    ("wrong", "kept"),
    [({}, (ADDED,)), ({"what": "killed"}, ()), ({"system_id": 0}, ()), ({"t_us": 0}, ()), ({"name": "x" * 201}, ())],
)
def test_changes_of_the_fleet_come_back_unless_they_cannot_be_right(tmp_path, wrong, kept):
    row = json.loads(event_row(Event(t_us=1, level="info", kind="operator", text="x", change=ADDED)))
    row["change"] |= wrong
    (tmp_path / "events.jsonl").write_text(json.dumps(row) + "\n")
    assert read_changes(tmp_path) == kept and read_events(tmp_path / "events.jsonl")[1] == 1 - len(kept)


def test_an_unknown_place_is_read_as_unknown(tmp_path):
    (tmp_path / "events.jsonl").write_text(line(STATED, cx=None, cy=None) + "\n")
    (found,) = read_statements(tmp_path, (12,))
    assert math.isnan(found.cx) and math.isnan(found.cy)


def test_a_folder_without_events_has_no_statements(tmp_path):
    assert read_statements(tmp_path, (12,)) == []
