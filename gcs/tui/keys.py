"""Every key of the station in one table: bindings, hints and help read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from textual.binding import Binding
from textual.keys import format_key

Hint = tuple[str, str]
"""Keys as they are shown, one letter each or one word, and what they do."""


def _key(keys: str, action: str, label: str, tooltip: str, *, shown: str | None = None, id: str) -> Binding:
    return Binding(keys, action, label, id=id, tooltip=tooltip, key_display=shown, show=False)


THEME: Final = _key("t", "next_theme", "theme", "Theme: dark, light, high contrast", id="station.theme")
"""Key of both apps."""
REPLAY: Final = (
    _key("space", "toggle_play", "play", "Play or pause", id="replay.play"),
    _key("left", "jump(-5)", "−5 s", "Back 5 seconds", id="replay.back", shown="←"),
    _key("right", "jump(5)", "+5 s", "Forward 5 seconds", id="replay.forward", shown="→"),
    _key("shift+left", "jump(-30)", "−30 s", "Back 30 seconds", id="replay.far_back", shown="shift ←"),
    _key("shift+right", "jump(30)", "+30 s", "Forward 30 seconds", id="replay.far_forward", shown="shift →"),
    _key("comma", "step(-1)", "frame", "One frame back", id="replay.step_back", shown=","),
    _key("full_stop", "step(1)", "frame", "One frame forward", id="replay.step", shown="."),
    _key("left_square_bracket", "speed(-1)", "slower", "Slower, down to 0.1 times", id="replay.slower", shown="["),
    _key("right_square_bracket", "speed(1)", "faster", "Faster, up to 20 times", id="replay.faster", shown="]"),
    _key("home", "edge(0)", "start", "Go to the start", id="replay.start"),
    _key("end", "edge(1)", "end", "Go to the end", id="replay.end"),
    _key("g", "go_to", "go to", "Go to a time: 1:30, +10, 50% or 10:33:12Z", id="replay.go"),
    _key("n", "event(1)", "event", "Go to the next event that the log shows, or of N's kind", id="replay.next"),
    _key("p", "event(-1)", "event", "Go to the event before", id="replay.previous"),
    _key("N", "jumps", "kind", "What n and p go to: the log, alarms, marks, gaps, warnings, names", id="replay.kind"),
)
PANES: Final = (
    _key("v", "pane('video')", "video", "Video: show and focus, again to hide", id="pane.video"),
    _key("M", "pane('map')", "map", "Map: show and focus, again to hide", id="pane.map"),
    _key("f", "pane('fleet')", "fleet", "Fleet table: show and focus, again to hide", id="pane.fleet"),
    _key("i", "pane('identity')", "identity", "Identity: evidence of the vehicle, again to hide", id="pane.identity"),
    _key("e", "pane('events')", "events", "Event log: show and focus, again to hide", id="pane.events"),
    _key("z", "maximise", "zoom", "Focused pane over the whole screen and back", id="pane.maximise"),
    _key("Z", "inset", "enlarge", "Video: the picked vehicle enlarged in a corner, again to hide", id="video.inset"),
    _key("C", "next_view", "camera", "The next camera, where a flight has several", id="video.camera"),
    _key("4", "tiles", "cameras", "Video: all cameras beside each other, again for the one on show", id="video.tiles"),
    _key("1", "layout(1)", "video", "Layout: video first", id="layout.video"),
    _key("2", "layout(2)", "map", "Layout: map first", id="layout.map"),
    _key("3", "layout(3)", "both", "Layout: video and map above the whole table", id="layout.both"),
)
LOOK: Final = (
    _key("up,k", "pick(-1)", "vehicle", "Vehicle or box without a name above", id="pick.up", shown="↑"),
    _key("down,j", "pick(1)", "vehicle", "Vehicle or box without a name below", id="pick.down", shown="↓"),
    _key(
        "slash", "find", "find", "Vehicle by its name or id; enter keeps it, esc goes back", id="pick.find", shown="/"
    ),
    _key(
        "escape",
        "release",
        "back",
        "Leave the zoomed pane, then the search, then the vehicle",
        id="pick.none",
        shown="esc",
    ),
    _key("o", "order", "by trouble", "Fleet: in order of trouble, and back", id="fleet.order"),
    _key("plus", "zoom(1)", "closer", "Map: closer", id="map.closer", shown="+"),
    _key("minus", "zoom(-1)", "farther", "Map: farther", id="map.farther", shown="-"),
    _key("0", "zoom(0)", "fit", "Map: fit everything", id="map.fit"),
    _key("c", "follow", "follow", "Map: follow all, UAV or the selected vehicle", id="map.follow"),
    _key("x", "evidence", "evidence", "Identity: evidence for analysts and back", id="identity.evidence"),
    _key("l", "level", "level", "Event log: all, warnings, alarms", id="events.level"),
)
STATION: Final = (
    _key(
        "u",
        "command",
        "command",
        "Command the UAV, about the selected vehicle (gcs fly --command)",
        id="station.command",
    ),
    _key("p", "preflight", "before", "Before take-off: what is well, and what to do", id="flight.before"),
    _key("F", "fleet", "fleet", "Who is in the fleet: take in, leave out, rename", id="flight.fleet"),
    _key("X", "practise", "trouble", "Practise: a trouble of a simulated fleet (gcs demo --live)", id="flight.trouble"),
    _key("b", "accept_held", "accept", "Accept vehicles whose signed packets are held", id="station.believe"),
    _key(
        "V", "take_rival_video", "take", "Take the other video where two senders contest its port", id="station.video"
    ),
    _key("equals_sign", "state_name", "name", "State which vehicle the picked box is", id="station.name", shown="="),
    _key(
        "backspace",
        "undo_statement",
        "withdraw",
        "Withdraw what was stated of the picked box, else the latest",
        id="station.withdraw",
        shown="⌫",
    ),
    _key("m", "mark", "mark", "Mark this moment with a text", id="station.mark"),
    _key("s", "still", "still", "Still: save the full frame with names as PNG", id="station.still"),
    _key("S", "save", "save", "Save this screen as SVG, never over a file", id="station.save"),
    _key("w", "save_mission", "mission", "Save the mission as a file, to fly it again", id="station.mission"),
    THEME,
    _key("ctrl+p", "command_palette", "palette", "Command palette: any action by its words", id="station.palette"),
    _key("question_mark", "help", "help", "All keys, marks and colours, by pages", id="station.help", shown="?"),
    _key(
        "q,ctrl+q",
        "leave",
        "quit",
        "Quit; ends a flight and seals its recording, asked first",
        id="station.quit",
        shown="q",
    ),
)

ALARMS: Final = (
    _key("a", "pane('alarms')", "alarms", "Alarms: show and focus, again to hide", id="pane.alarms"),
    _key("A", "acknowledge", "seen", "Acknowledge all alarms", id="alarms.seen"),
)

GROUPS: Final = (("Replay", REPLAY), ("Panes", PANES), ("Look", LOOK), ("Station", STATION), ("Alarms", ALARMS))
BINDINGS: Final = [binding for _, group in GROUPS for binding in group]
REPLAY_ACTIONS: Final = frozenset({"toggle_play", "jump", "step", "speed", "edge", "go_to", "event", "jumps"})
LIVE_ACTIONS: Final = frozenset({"preflight", "fleet", "practise"})

LIVE_HINTS: Final = (
    ("q", "quit"),
    ("?", "help"),
    ("↑↓/", "vehicle"),
    ("z", "zoom"),
    ("Z", "enlarge"),
    ("123", "layout"),
    ("vMfie", "panes"),
    ("l", "level"),
    ("+-0", "map"),
    ("c", "follow"),
    ("=", "name"),
    ("m", "mark"),
    ("s", "still"),
)
"""Keys and a word for the last row, the most needed first."""
COMMAND_HINTS: Final = (*LIVE_HINTS[:2], ("u", "command"), *LIVE_HINTS[2:])
"""Equivalent of ``LIVE_HINTS`` for a station that may command."""
REPLAY_HINTS: Final = (
    ("q", "quit"),
    ("?", "help"),
    ("space", "play"),
    ("←→", "5 s"),
    ("[]", "speed"),
    ("g", "go to"),
    ("np", "event"),
    ("↑↓/", "vehicle"),
    ("z", "zoom"),
    ("Z", "enlarge"),
    (",.", "frame"),
    ("123", "layout"),
    ("vMfie", "panes"),
    ("l", "level"),
    ("+-0", "map"),
    ("c", "follow"),
    ("m", "mark"),
    ("s", "still"),
)
PANE_HINTS: Final[Mapping[str, tuple[Hint, ...]]] = MappingProxyType(
    {
        "video": (("↑↓", "pick"), ("=", "name"), ("s", "still"), ("z", "zoom")),
        "map": (
            *(("←↓↑→", "pan"), ("+-0", "zoom"), ("c", "follow"), ("r", "ruler"), ("T", "trails"), ("h", "home")),
            ("z", "whole screen"),
        ),
        "fleet": (("↑↓/", "vehicle"), ("o", "by trouble"), ("z", "all columns")),
        "identity": (("↑↓", "pick"), ("=", "name"), ("x", "evidence"), ("z", "zoom")),
        "alarms": (("↑↓", "alarm"), ("enter", "seen"), ("A", "all seen"), ("z", "zoom")),
        "events": (("↑↓", "scroll"), ("l", "level"), ("/", "search"), ("z", "zoom")),
    }
)
"""Keys that act in a pane while it has the focus, by the pane's id: in its heading, and first in the last row."""
_KEYS_BY_SIGN: Final = {format_key(key): key for binding in BINDINGS for key in binding.key.split(",")} | {
    "enter": "enter"
}


MAX_HINTS: Final = 6
HELP_HINT: Final = ("?", "help")


def hints_for(base: Sequence[Hint], pane: str) -> list[Hint]:
    """The six hints of the last row: what acts in the focused pane, then anywhere, and how to get help and to leave.

    Args:
        base: The row without a focus.
        pane: The focused pane's id, empty for none.
    """
    if base[1:2] != (HELP_HINT,):  # an app without panes has few
        return list(base)
    own = PANE_HINTS.get(pane, ())
    taken = {sign for keys, _ in own for sign in signs_in(keys)}
    rest = [hint for hint in base[2:] if not taken & set(signs_in(hint[0]))]
    leave, ask = base[:2]
    return [*[*own, *rest][: MAX_HINTS - 2], ask, leave]


def signs_in(keys: str) -> dict[str, str]:
    """Each sign of a hint's keys, and the key that it is to Textual.

    Raises:
        KeyError: One is neither a letter nor bound to anything.
    """
    signs = [keys] if keys in _KEYS_BY_SIGN else keys
    return {sign: sign if sign.isalpha() and len(sign) == 1 else _KEYS_BY_SIGN[sign] for sign in signs}
