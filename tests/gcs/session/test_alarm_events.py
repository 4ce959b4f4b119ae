"""Alarms are in the event log and the program's log with their keys and levels."""

from __future__ import annotations

import json
import logging
from dataclasses import replace

from gcs.session.event_log import EventLog, read_events
from gcs.snapshot import Event

CAME = Event(
    t_us=1_000_000,
    level="alarm",
    kind="identity",
    text="Delta: its position contradicts the video",
    system_id=14,
    alarm="conflict 14",
    alarm_level="alarm",
)
OVER = replace(CAME, t_us=9_000_000, level="info", text=f"over after 8 s: {CAME.text}", over=True)
SEEN = replace(CAME, kind="operator", level="info", text="seen", alarm_level="")
PLAIN = Event(t_us=2_000_000, level="alarm", kind="link", text="udp: lost, trying on")


def test_what_is_written_is_read_again(tmp_path, caplog):
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    with caplog.at_level(logging.INFO):
        log.write([CAME, PLAIN, SEEN, OVER])
    log.close()
    assert read_events(path) == ([CAME, PLAIN, SEEN, OVER], 0)
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert (rows[0]["alarm"], rows[0]["alarm_level"], rows[0]["over"]) == ("conflict 14", "alarm", False)
    assert "alarm" not in rows[1] and "alarm_level" not in rows[2]
    assert caplog.messages[0] == f"identity: {CAME.text} [alarm conflict 14]"
    assert [event.acknowledges for event in (CAME, PLAIN, SEEN, OVER)] == ["", "", "conflict 14", ""]


def test_a_row_of_an_older_recording_and_one_with_a_strange_level(tmp_path):
    path = tmp_path / "events.jsonl"
    old = '{"time_us":1,"level":"alarm","kind":"video","system_id":null,"text":"the video has stopped"}'
    strange = old.replace('"text"', '"alarm":"video","alarm_level":"loud","over":true,"text"')
    path.write_text(f"{old}\n{strange}\n")
    events, skipped = read_events(path)
    assert skipped == 1
    assert [(event.text, event.alarm, event.alarm_level) for event in events] == [("the video has stopped", "", "")]


def test_rows_nested_without_end_are_skipped(tmp_path):
    path = tmp_path / "events.jsonl"
    path.write_text(
        '{"more": ' + "[" * 100_000 + "\n" + '{"time_us": 1, "level": "info", "kind": "link", "text": "a"}\n'
    )
    events, skipped = read_events(path)
    assert ([event.text for event in events], skipped) == (["a"], 1)
