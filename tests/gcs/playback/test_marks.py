"""Marks that are made while a recording is replayed: kept beside what was recorded, which stays as it is."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager

import pytest

from gcs.playback.replay import Replay
from gcs.session.event_log import marks_path, read_events
from gcs.session.session import open_session
from tests.support.bundled import ROOT

LOG = ROOT / "sitl_logs" / "ardupilot-swarm" / "telemetry.tlog"


@contextmanager
def replaying(path):
    replay = Replay(open_session(path))
    replay.pause()
    try:
        yield replay
    finally:
        replay.stop()


def marks(replay):
    return [(event.t_us, event.text, event.system_id) for event in replay.events() if event.kind == "mark"]


def test_marks_go_to_a_file_of_their_own_and_are_there_again(tmp_path):
    folder = tmp_path / "flight"
    folder.mkdir()
    shutil.copy(LOG, folder)
    (folder / "events.jsonl").write_text("")
    with replaying(folder) as replay:
        late, early = replay.start_us + 9_000_000, replay.start_us + 2_000_000
        replay.mark(late, "turns\nround \x1b[31m")
        replay.mark(early, "starts", 12)
        assert [t_us for t_us, *_ in marks(replay)] == [early, late]
        times = [event.t_us for event in replay.events()]
        assert times == sorted(times)
    assert (folder / "events.jsonl").read_text() == ""
    rows = [json.loads(line) for line in (folder / "marks.jsonl").read_text().splitlines()]
    assert [(row["time_us"], row["kind"], row["system_id"]) for row in rows] == [
        (late, "mark", None),
        (early, "mark", 12),
    ]
    with (folder / "marks.jsonl").open("a") as file:
        file.write('{"time_us": "soon"}\n')
    with replaying(folder) as replay:
        again = marks(replay)
        assert again[0] == (early, "starts", 12) and again[1][0] == late and "\x1b" not in again[1][1]
        assert any("1 lines could not be read" in event.text for event in replay.events())


def test_marks_of_a_bare_log_are_beside_it(tmp_path):
    log = tmp_path / "swarm.tlog"
    shutil.copy(LOG, log)
    with replaying(log) as replay:
        replay.mark(replay.start_us, "here")
    assert marks_path(log) == tmp_path / "swarm.tlog.marks.jsonl"
    events, skipped = read_events(marks_path(log))
    assert [event.text for event in events] == ["here"] and skipped == 0


def test_a_mark_that_cannot_be_written_is_refused(tmp_path):
    log = tmp_path / "swarm.tlog"
    shutil.copy(LOG, log)
    with replaying(log) as replay:
        marks_path(log).symlink_to(tmp_path / "elsewhere")
        with pytest.raises(OSError):
            replay.mark(replay.start_us, "here")
        assert marks(replay) == [] and not (tmp_path / "elsewhere").exists()
