"""Where a replay begins to play."""

from __future__ import annotations

import shutil
from pathlib import Path

from gcs.playback.replay import Replay
from gcs.session.session import open_session
from tests.support.bundled import CURVED_ROAD


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
