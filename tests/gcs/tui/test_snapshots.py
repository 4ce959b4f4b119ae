"""Pictures of every pane, accepted by a person, at three sizes and in two themes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.snapshot import Alarm
from gcs.tui import RollcallApp
from tests.support.fake_station import HEIGHT, START_US, WIDTH, FakeStation, make_snapshot

SIZES = ((80, 24), (120, 40), (160, 48))
VIEWS = {
    "names": ("down", "down"),  # video, fleet, why this vehicle, events
    "map": ("2", "down", "down", "down"),
    "alarms": ("a", "down"),  # in flight
}
"""Keys that lead to what is shown."""
TROUBLES = (
    (17, "alarm", "UGV-17: no heartbeat", "its radio or power is gone, or it is out of range"),
    (0, "alarm", "/dev/ttyUSB0: nothing is received any more", "check radio, cable and port"),
    (13, "warning", "UGV-13: position stale", "check its stream rates and its receiver; it cannot be named meanwhile"),
)


def make_app(view: str, theme: str) -> RollcallApp:
    """A paused replay, or a flight, that never changes, in half blocks.

    The frame is of one colour: shrinking a real one rounds differently on other processors.
    """
    live = view == "alarms"
    image = None if view == "map" else np.full((HEIGHT, WIDTH, 3), (72, 92, 98), dtype=np.uint8)
    alarms = tuple(
        Alarm(
            key=text,
            level=level,
            kind="vehicle",
            text=text,
            advice=advice,
            since_us=START_US + 200_000_000 + at,
            system_id=system_id,
        )
        for at, (system_id, level, text, advice) in enumerate(TROUBLES)
    )
    snapshot = replace(make_snapshot(live=live), image=image, alarms=alarms if live else ())
    return RollcallApp(FakeStation(live=live, snapshot=snapshot), graphics="blocks", theme=theme)


@pytest.mark.parametrize("theme", ["dark", "light"])
@pytest.mark.parametrize("size", SIZES, ids=[f"{columns}x{rows}" for columns, rows in SIZES])
@pytest.mark.parametrize("view", VIEWS)
def test_screen_looks_as_it_did(snap_compare, view, size, theme):
    assert snap_compare(make_app(view, theme), press=VIEWS[view], terminal_size=size)
