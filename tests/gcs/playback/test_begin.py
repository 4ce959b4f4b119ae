"""Where a replay begins to play."""

from __future__ import annotations

import shutil
from pathlib import Path

from gcs.playback.replay import Replay
from gcs.session.event_log import append_event
from gcs.session.session import open_session
from gcs.snapshot import Event
from tests.support.bundled import CURVED_ROAD
from tests.support.waiting import until


def test_before_the_flight_nothing_of_it_is_shown(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(CURVED_ROAD, tmp_path / "recording"))
    heard = Event(t_us=1_795_169_970_000_000, level="info", kind="vehicle", text="rover 11 is there")
    append_event(folder / "events.jsonl", heard)
    replay = Replay(open_session(folder))
    try:
        replay.pause()
        assert replay.start_us == heard.t_us
        replay.seek(replay.start_us)
        assert until(lambda: (now := replay.latest()) and now.begins_us > 0)
        now = replay.latest()
        assert now is not None
        assert now.begins_us > replay.now_us == now.now_us and now.vehicles == now.alarms == ()
        replay.seek(now.begins_us)
        assert until(lambda: (then := replay.latest()) and then.vehicles and not then.begins_us)
    finally:
        replay.stop()


def test_a_replay_begins_at_its_first_frame_and_its_time_line_before(tmp_path: Path) -> None:
    replay = Replay(open_session(Path(shutil.copytree(CURVED_ROAD, tmp_path / "recording"))))
    try:
        replay.pause()
        first_frame_us = 1_795_170_000_001_133
        assert replay.start_us < first_frame_us - 1_000_000
        assert first_frame_us <= replay.now_us < first_frame_us + 1_000_000
        replay.seek(replay.start_us)
        assert replay.now_us == replay.start_us
    finally:
        replay.stop()
