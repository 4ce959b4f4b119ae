from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.tui import RollcallApp
from tests.support.fake_station import HEIGHT, WIDTH, FakeStation, make_snapshot


def make_app(*, frame: bool) -> RollcallApp:
    """A paused replay that never changes, in half blocks.

    The frame is of one colour: shrinking a real one rounds differently on other processors.
    """
    image = np.full((HEIGHT, WIDTH, 3), (72, 92, 98), dtype=np.uint8) if frame else None
    return RollcallApp(FakeStation(snapshot=replace(make_snapshot(), image=image)), graphics="blocks")


@pytest.mark.parametrize(
    ("size", "keys", "frame"),
    [
        ((80, 24), ("down", "down"), True),  # over SSH: video, slim fleet, why this vehicle, events
        ((160, 48), ("3", "down", "down", "down", "down"), False),  # everything at once, the frame lost
    ],
    ids=["80x24", "160x48"],
)
def test_screen_looks_as_it_did(snap_compare, size, keys, frame):
    assert snap_compare(make_app(frame=frame), press=keys, terminal_size=size)
