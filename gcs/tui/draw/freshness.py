"""Ages from which a value is drawn as old, and is not shown at all. Pure; seconds in.

The one place for these bounds: tables, facts and marks on the map read it.
"""

from __future__ import annotations

import math
from typing import Final, Literal

from gcs.snapshot import VehicleRow
from gcs.tui.draw.format import age, metres
from gcs.tui.palette import FAINT
from gcs.tui.themes import Colour
from mavlink.state import SILENT_S

Freshness = Literal["fresh", "old", "gone"]
"""``fresh`` is shown as it is, ``old`` dimmed and with its age where there is room, ``gone`` not at all."""

GONE_S: Final = 60.0
"""Age beyond which a value is not shown: at 1 m/s a vehicle has left the picture by then, and its mode may have
changed."""
USABLE_M: Final = 100.0
"""A wider 1σ is larger than what most pictures show of the ground: no place is known."""
UNKNOWN: Final = "–"


def freshness(age_s: float, *, fresh_s: float = SILENT_S) -> Freshness:
    """The style of a value of this age.

    Args:
        age_s: inf or NaN for what was never received.
        fresh_s: Until when it counts as new: three heartbeats of one a second unless it comes more or less often.
    """
    if age_s <= fresh_s:
        return "fresh"
    return "old" if age_s <= GONE_S else "gone"


def aged(text: str, colour: Colour, age_s: float, width: int) -> tuple[str, Colour]:
    """Return a value and its colour as they are drawn at its age."""
    state = freshness(age_s)
    if state == "fresh":
        return text, colour
    if state == "gone" or text in ("", UNKNOWN):
        return UNKNOWN, FAINT
    dated = f"{text} {age(age_s)}"
    return dated if len(dated) <= width else text, FAINT


def fix_age_s(row: VehicleRow) -> float:
    """Age of what the GNSS receiver reports; that of the heartbeat where it is not known."""
    own = row.condition.receiver_age_s
    return own if math.isfinite(own) else row.heartbeat_age_s


def spread(std_m: float, age_s: float) -> str:
    """1σ of a place, ``–`` when it is unknown, of a place that is gone, or too wide to tell any."""
    return metres(std_m) if std_m <= USABLE_M and freshness(age_s) != "gone" else UNKNOWN
