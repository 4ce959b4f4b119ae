"""Taking the other video where two senders contest its port: both addresses, asked once more."""

from __future__ import annotations

from typing import Any

from textual.app import App

from gcs.snapshot import Snapshot
from gcs.station import Station
from gcs.tui.screens.prompts import Confirm

__all__ = ["ask_for_rival_video"]

NO_RIVAL = "only one sender's video comes"


def ask_for_rival_video(app: App[Any], station: Station, snapshot: Snapshot | None) -> None:
    """Let the operator take the other video.

    Args:
        app: to show the question.
        station: takes the answer.
        snapshot: the newest.
    """
    health = snapshot.health if snapshot else None
    if health is None or not health.video_rival:
        app.notify(NO_RIVAL, severity="warning", timeout=6, markup=False)
        return

    def take(yes: bool | None) -> None:
        if yes:
            station.take_rival_video()

    app.push_screen(Confirm(f"Take the video of {health.video_rival} instead of {health.video_sender}"), take)
