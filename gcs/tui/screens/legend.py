"""Meaning of the marks, colours and shortened words on the screens, for the help."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs.snapshot import Standing
from gcs.tui.draw.freshness import GONE_S
from gcs.tui.draw.map_canvas import BOX_MARK, STANDING_MARKS, UAV_MARK
from gcs.tui.draw.map_lines import CURSOR_MARK, HOME_MARK, PICK_MARKS
from gcs.tui.draw.moments import NOT_ANALYSED as NOT_ANALYSED_SIGN
from gcs.tui.draw.moments import SIGNS as MOMENT_SIGNS
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, INK, LINE, WARN, standing_colour
from gcs.tui.themes import Colour
from mavlink.state import SILENT_S

MEANINGS: Final[Mapping[Standing, str]] = MappingProxyType(
    {
        "confirmed": "confirmed: a box is this vehicle",
        "tentative": "tentative: a box may be this vehicle, or an alarm forbids to act on its name",
        "coasting": "coasting: its box is predicted, not seen in this frame",
        "unidentified": "unknown: it should be in the picture, and no box is it",
        "out of view": "out of view: it reports a place that the picture does not show",
        "no position": "no position, never heard, refused, same place: no place of it can be used",
        "misplaced": "misplaced: its position is not to be relied on, by the video or by its own word",
        "no new frame": "no new frame: the video has shown nothing new for two seconds",
    }
)

LEGEND: Final[list[tuple[str, list[tuple[str, Colour, str]]]]] = [
    (
        "Names on the video",
        [
            (
                "UGV-3 97%",
                Colour.CONFIRMED,
                "confirmed: the box is this vehicle, with this probability unless there are many",
            ),
            ("UGV-3? 61%", Colour.TENTATIVE, "tentative: the best guess, not to be relied on"),
            ("!UGV-3? 77%", ALARM, "an alarm forbids to act on this name, on the map too"),
            ("~UGV-3 88%", Colour.COASTING, "coasting: predicted, not seen in this frame"),
            ("?", Colour.UNIDENTIFIED, "unknown: a vehicle without a name"),
            ("#5", Colour.UNIDENTIFIED, "the same, with its number in the pictures of all cameras: no system id"),
            ("faint", FAINT, "held while no new frame comes; how long is above the picture"),
            ("tick", INK, "the front of a box"),
            ("3", INK, "a number alone is a system id, where the name has no room"),
            ("+3", INK, "three more names that have no room"),
        ],
    ),
    ("Standings, as on the map", [(STANDING_MARKS[each], standing_colour(each), MEANINGS[each]) for each in MEANINGS]),
    (
        "Map",
        [
            (UAV_MARK, ACCENT, "the UAV"),
            (BOX_MARK, Colour.UNIDENTIFIED, "a box without a name"),
            ("line", INK, "from a mark: its heading, or to where its box is"),
            ("circle", LINE, "1σ of a reported place"),
            ("dots", LINE, "what of the ground the picture shows"),
            ("far dots", WARN, "a fence of the mission"),
            ("trail", INK, "where a vehicle was, fading; interrupted where nobody knows"),
            (HOME_MARK, FAINT, "home: where the UAV was first"),
            (" ".join((CURSOR_MARK, *PICK_MARKS)), BRIGHT, "the ruler's cursor, and what it measures from and to"),
        ],
    ),
    (
        "Time line",
        [
            *((sign, INK, kind) for kind, sign in MOMENT_SIGNS.items()),
            (NOT_ANALYSED_SIGN, FAINT, "not analysed yet"),
            ("…", WARN, "before the time: the screen still shows another moment"),
        ],
    ),
    (
        "Values and alarms",
        [
            ("!! ALARM", ALARM, "a name may be wrong, or a vehicle or the recording may be lost"),
            ("!  WARN", WARN, "something that will need you"),
            ("faint", FAINT, f"older than {SILENT_S:g} s, with its age where there is room"),
            ("…", INK, "more, for which there is no room: z shows the pane on the whole screen"),
            ("–", FAINT, f"unknown, or older than {GONE_S:g} s"),
        ],
    ),
]
"""Headings, and for each sign its colour and meaning."""
