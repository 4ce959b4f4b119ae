from __future__ import annotations

from dataclasses import replace

import pytest

from gcs.tui import RollcallApp
from tests.fake_station import FakeStation, make_snapshot


def make_app(*, picture: bool) -> RollcallApp:
    """A paused replay that never changes, in half blocks."""
    snapshot = make_snapshot()
    return RollcallApp(
        FakeStation(snapshot=snapshot if picture else replace(snapshot, image=None)), graphics="blocks"
    )


@pytest.mark.parametrize(
    ("size", "keys", "picture"),
    [
        ((80, 24), ("down", "down"), True),  # over SSH: video, slim fleet, why this vehicle, events
        ((160, 48), ("3", "down", "down", "down", "down"), False),  # everything at once, the picture lost
    ],
    ids=["80x24", "160x48"],
)
def test_screen_looks_as_it_did(snap_compare, size, keys, picture):
    assert snap_compare(make_app(picture=picture), press=keys, terminal_size=size)
