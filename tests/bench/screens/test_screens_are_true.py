"""What the screens say is so: two flights with every trouble, at five sizes, every screen checked.

``python -m bench.screens`` does it for many more flights and looks.
"""

import pytest

from bench.flights import polls_of
from bench.screens.__main__ import NAMES, SIZES, script_of
from bench.screens.checker import check_screens

pytestmark = pytest.mark.slow

LOOKS = 30
"""Screens of each size: five of every view."""
FLIGHTS = (
    script_of(
        "few frames, holes, restarts, names with which others begin",
        fps=2.0,
        latency_s=0.3,
        names=NAMES,
        silent={11: (3.0, 9.0), 13: (4.0, 99.0)},
        disk_fails=(6.0, 9.0),
        injected={"no_video": ((5.0, 6.2), (8.0, 12.0)), "restarted": frozenset((11,))},
    ),
    script_of(
        "forty vehicles, a second sender, floods",
        fps=4.0,
        vehicles=40,
        ground="open",
        events=(5.0, 12.0),
        silent={20: (6.0, 99.0)},
        injected={"no_video": ((9.0, 10.5),), "impostor": (4.0, 9.0), "texts": (5.0, 12.0)},
    ),
)


@pytest.fixture(scope="module", params=FLIGHTS, ids=[script.name for script in FLIGHTS])
def moments(request):
    found = polls_of(request.param)
    return found[:: max(1, len(found) // LOOKS)]


@pytest.mark.parametrize("size", SIZES, ids=[f"{columns}x{rows}" for columns, rows in SIZES])
async def test_every_screen_says_what_is_so(moments, size):
    screens, found = await check_screens(moments, size)
    assert screens >= LOOKS
    assert not found
