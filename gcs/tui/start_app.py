"""The screen before a flight without a mission file: who is heard, what each is to be, and which video is offered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.strip import Strip
from textual.widget import Widget

from gcs.errors import SessionError
from gcs.flight.devices import cameras, serial_links
from gcs.flight.listening import HEARD_VIDEO, Listening
from gcs.flight.video import check_source
from gcs.mission.mission import usual_name
from gcs.mission.roster import FleetChoice, HeardVehicle, Role, proposed_roles
from gcs.mission.written import MISSION_FILE
from gcs.tui.draw.format import age
from gcs.tui.draw.strips import Part, blank, fitted, folded, line, split_line
from gcs.tui.keys import THEME
from gcs.tui.palette import ACCENT, ALARM, BRIGHT, FAINT, GOOD, HEAD, INK, PANEL, PICKED, WARN, ink
from gcs.tui.panes.key_hints import KeyHints
from gcs.tui.screens.prompts import Prompt
from gcs.tui.terminal.terminal_app import TerminalApp
from gcs.tui.themes import Colour, ThemeName
from infra.plain_text import plain
from infra.secrets import concealed
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.protocol.packet import Auth
from mavlink.state import SILENT_S
from vision.errors import VideoError

POLL_S = 0.1
LONG_S = 5.0
"""Time by which everybody has heard a vehicle that sends, if there is one."""
NAME_CELLS = 14
COLUMNS: Final = (
    ("ROLE", 6),
    ("ID", 3),
    ("NAME", NAME_CELLS),
    ("TYPE", 10),
    ("AUTOPILOT", 9),
    ("POSITION", 9),
    ("SIGNED", 17),
)
ROLE_COLOURS: Final[Mapping[Role, Colour]] = {"films": ACCENT, "named": GOOD, "out": FAINT}
HINTS: Final = (
    ("enter", "fly"),
    ("q", "quit"),
    ("space", "in/out"),
    ("f", "films"),
    ("r", "rename"),
    ("v", "video"),
    ("s", "serial"),
    ("t", "theme"),
    ("↑↓", "vehicle"),
)
"""Keys for the last row; all but the arrows, which every list has, fit in 80 columns."""


class StartApp(TerminalApp):
    """Listens until the operator flies or quits.

    Args:
        listening: what is heard.
        chosen: roles that the command line gives.
        whole_fleet: whether ground vehicles that it does not name are in the fleet.
        video: as of the command line; None: what is offered or heard.
        theme: colours to begin with.

    Attributes:
        found: who is to fly; None until the operator says so.
    """

    CSS_PATH = "app.tcss"
    TITLE = "Rollcall"
    ENABLE_COMMAND_PALETTE = False
    ALLOW_SELECT = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "fly", "Fly", id="start.fly", tooltip="Fly with those who film and are named"),
        Binding("up,k", "pick(-1)", "Up", id="start.up", tooltip="Vehicle above"),
        Binding("down,j", "pick(1)", "Down", id="start.down", tooltip="Vehicle below"),
        Binding("space", "in_or_out", "In or out", id="start.toggle", tooltip="Leave it out, or take it in again"),
        Binding("f", "film", "Films", id="start.film", tooltip="It carries the camera, and no other one"),
        Binding("r", "rename", "Rename", id="start.rename", tooltip="Call it otherwise"),
        Binding("v", "video", "Video", id="start.video", tooltip="Type the address of the video"),
        Binding("s", "serial", "Serial port", id="start.serial", tooltip="Listen to a radio at a serial port, too"),
        THEME,
        Binding("q,ctrl+q,escape", "leave", "Quit", id="start.quit", tooltip="Quit; nothing has flown"),
    ]

    def __init__(
        self,
        listening: Listening,
        chosen: Mapping[int, Role],
        *,
        whole_fleet: bool = True,
        video: str | None = None,
        theme: ThemeName = "dark",
    ) -> None:
        super().__init__(theme=theme)
        self.found: FleetChoice | None = None
        self._listening = listening
        self._chosen, self._whole_fleet = dict(chosen), whole_fleet
        self._names: dict[int, str] = {}
        self._video = video
        self._picked = 0
        self._pick_stays = False
        """True once the operator has picked one, or done something with it: before, the first row is."""
        self._table = _HeardTable(id="panes")

    def compose(self) -> ComposeResult:
        """Yield the table and the keys."""
        yield self._table
        yield KeyHints(HINTS, id="hints")

    def on_mount(self) -> None:
        """Start to listen."""
        self._poll()
        self.set_interval(POLL_S, self._poll)

    @property
    def roles(self) -> dict[int, Role]:
        """The present role of each, by system id."""
        return proposed_roles(self._listening.roster.vehicles, self._chosen, whole_fleet=self._whole_fleet)

    def action_fly(self) -> None:
        """Fly, unless something is not clear yet."""
        roles = self.roles
        standing, good = _standing(roles)
        if not good:
            self.notify(standing, severity="warning", timeout=6, markup=False)
            return
        self.found = FleetChoice(
            roles=roles, names=dict(self._names), chosen=frozenset(self._chosen), video=self._video
        )
        self.exit()

    def action_leave(self) -> None:
        """Quit without a flight."""
        self.exit()

    def action_pick(self, steps: int) -> None:
        """Pick the vehicle above or below."""
        ids = list(self.roles)
        if ids:
            place = ids.index(self._picked) if self._picked in ids else 0
            self._picked, self._pick_stays = ids[min(max(place + steps, 0), len(ids) - 1)], True
        self._show_all()

    def action_pick_vehicle(self, system_id: int) -> None:
        """Pick a vehicle that was clicked."""
        self._picked, self._pick_stays = system_id, True
        self._show_all()

    def action_in_or_out(self) -> None:
        """Leave the picked one out, or take it in as what it is: an aircraft films, anything else is named."""
        if self._picked in (roles := self.roles):
            kinds = {each.system_id: each.role for each in self._listening.roster.vehicles}
            inside: Role = "films" if kinds.get(self._picked) == "films" else "named"
            self._choose(self._picked, inside if roles[self._picked] == "out" else "out")

    def action_film(self) -> None:
        """Let the picked vehicle carry the camera."""
        if self._picked in self.roles:
            self._choose(self._picked, "films")

    def action_rename(self) -> None:
        """Prompt for the picked one's name."""
        if (system_id := self._picked) not in self.roles:
            return

        def check(text: str) -> str:
            name = plain(text.strip())
            others = {each: self._called(each, role) for each, role in self.roles.items() if each != system_id}
            if name in others.values():
                raise ValueError("another vehicle is called that")
            return name

        def rename(name: str | None) -> None:
            if name:
                self._names[system_id] = name
            elif name is not None:
                self._names.pop(system_id, None)
            self._show_all()

        value = self._called(system_id, self.roles[system_id])
        self.push_screen(Prompt(f"Name of vehicle {system_id}", "nothing: as it was", check, value=value), rename)

    def action_video(self) -> None:
        """Prompt for the address of the video."""

        def check(text: str) -> str:
            try:
                check_source(text.strip())
            except VideoError as error:
                raise ValueError(str(error)) from error
            return text.strip()

        def take(text: str | None) -> None:
            if text is not None:
                self._video = text or None
            self._show_all()

        there = cameras()
        plugged_in = [f"{device} ({plain(name)})" for device, name in there.items()]
        hint = f"rtsp://192.168.1.10:8554/main, {', '.join(plugged_in) or '/dev/video0'}; nothing: as offered or heard"
        comes = self._listening.offer or self._listening.hears_video
        value = self._video or ("" if comes else next(iter(there), ""))
        self.push_screen(Prompt("Address of the video", hint, check, value=value), take)

    def action_serial(self) -> None:
        """Prompt for a serial port: none is opened unasked, since anything may hang on it."""

        def open_port(text: str) -> str:
            try:
                self._listening.add_link(text.strip())
            except (LinkError, SessionError) as error:
                raise ValueError(str(error)) from error
            return text

        there = self._serial_links()
        hint = f"here: {', '.join(there) or 'none'}; enter opens it, with its rate: 57600, 115200 or 921600"
        value = next(iter(there), "/dev/ttyUSB0,57600")
        self.push_screen(Prompt("Serial port to listen to", hint, open_port, value=value))

    def _serial_links(self) -> list[str]:
        """Serial ports that are there and not listened to."""
        return [link for link in serial_links() if link not in self._listening.links]

    def _choose(self, system_id: int, role: Role) -> None:
        if role == "films":  # one films: who did before is as it would be without a choice
            self._chosen = {i: each for i, each in self._chosen.items() if each != "films"}
        self._chosen[system_id], self._pick_stays = role, True
        self._show_all()

    def _called(self, system_id: int, role: Role) -> str:
        return self._names.get(system_id, "" if role == "out" else usual_name(system_id, films=role == "films"))

    def _poll(self) -> None:
        if self.to_end():
            self.exit()
            return
        self._listening.poll(0.0)
        self._show_all()

    def _show_all(self) -> None:
        roles = self.roles
        if self._picked not in roles or not self._pick_stays:
            self._picked = min(roles, default=0)
        heard = {each.system_id: each for each in self._listening.roster.vehicles}
        several = list(roles.values()).count("films") > 1
        rows = [(i, _row(i, self._called(i, role), role, heard.get(i), several)) for i, role in sorted(roles.items())]
        self._table.show(self._heading(), rows, self._picked, self._below(roles))

    def _heading(self) -> tuple[Sequence[Part], Sequence[Part]]:
        listening = self._listening
        since = age((now_us() - listening.began_us) * 1e-6)
        where = f"listening on {listening.where} · {since} "
        return [(" Who flies?", ink(ACCENT, HEAD, bold=True))], [(where, ink(INK, HEAD))]

    def _below(self, roles: Mapping[int, Role]) -> list[list[Part]]:
        """Lines to be known under the table, the standing last."""
        standing, good = _standing(roles)
        lines = [[(" video  ", ink(FAINT)), self._video_part()]]
        ports = self._serial_links()
        if ports or (not roles and (now_us() - self._listening.began_us) * 1e-6 > LONG_S):
            lines.append(
                [(f" A radio on a serial port: s listens to it (here: {', '.join(ports) or 'none'})", ink(INK))]
            )
        for trouble in self._listening.troubles:
            lines += [[(f" {part}", ink(WARN))] for part in folded(plain(trouble), max(self.size.width - 2, 20))]
        if Path(MISSION_FILE).is_file():
            lines.append([(f" {MISSION_FILE} is here: gcs fly {MISSION_FILE} flies that one", ink(INK))])
        return [*lines, [(f" {standing}", ink(GOOD if good else WARN, bold=True))]]

    def _video_part(self) -> Part:
        if self._video is not None:
            return (f"{plain(concealed(self._video))}" if self._video else "none, as given"), ink(INK)
        if offer := self._listening.offer:
            return f"offered by the UAV: {plain(concealed(offer))}", ink(INK)
        if self._listening.hears_video:
            return f"heard at {HEARD_VIDEO}", ink(INK)
        return "none offered, and none heard on UDP 5600 yet: v types its address", ink(WARN)


class _HeardTable(Widget):
    """Rows of vehicles, and lines under them; a click picks."""

    ALLOW_SELECT: ClassVar[bool] = False

    def __init__(self, *, id: str) -> None:
        super().__init__(id=id)
        self._heading: tuple[Sequence[Part], Sequence[Part]] = (), ()
        self._vehicles: Sequence[tuple[int, Sequence[tuple[str, Colour]]]] = ()
        self._picked = 0
        self._below: list[list[Part]] = []

    def show(
        self,
        heading: tuple[Sequence[Part], Sequence[Part]],
        vehicles: Sequence[tuple[int, Sequence[tuple[str, Colour]]]],
        picked: int,
        below: list[list[Part]],
    ) -> None:
        """Draw these."""
        self._heading, self._vehicles, self._picked, self._below = heading, vehicles, picked, below
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Heading, titles, as many vehicles as there is room for about the picked one, and what is under them."""
        width = self.size.width
        if y == 0:
            return split_line(*self._heading, width)
        if y == 1:
            return blank(width)
        if y == 2:
            titles = "".join(f" {fitted(title, cells)}" for title, cells in COLUMNS)
            return line([(" " + titles, ink(FAINT))], width)
        shown = self._shown()
        place = y - 3
        if place < len(shown):
            return self._vehicle(*shown[place], width)
        place -= len(shown) + 1
        return line(self._below[place], width) if 0 <= place < len(self._below) else blank(width)

    def on_click(self, event: events.Click) -> None:
        """Pick the vehicle there."""
        shown, place = self._shown(), event.y - 3
        if 0 <= place < len(shown) and isinstance(self.app, StartApp):
            self.app.action_pick_vehicle(shown[place][0])

    def _shown(self) -> Sequence[tuple[int, Sequence[tuple[str, Colour]]]]:
        room = max(self.size.height - 4 - len(self._below), 1)
        ids = [system_id for system_id, _ in self._vehicles]
        place = ids.index(self._picked) if self._picked in ids else 0
        first = min(max(place - room // 2, 0), max(len(ids) - room, 0))
        return self._vehicles[first : first + room]

    def _vehicle(self, system_id: int, cells: Sequence[tuple[str, Colour]], width: int) -> Strip:
        picked = system_id == self._picked
        paper = PICKED if picked else PANEL
        parts: list[Part] = [("▌" if picked else " ", ink(ACCENT, paper))]
        for (text, colour), (_, room) in zip(cells, COLUMNS, strict=True):
            parts.append((f" {fitted(text, room)}", ink(colour, paper)))
        return line(parts, width, paper)


def _row(system_id: int, name: str, role: Role, heard: HeardVehicle | None, several: bool) -> list[tuple[str, Colour]]:
    """The cells of a vehicle, as ``COLUMNS`` has them; of several who could film none does yet."""
    text = FAINT if role == "out" else INK
    word = "…" if role == "out" and heard is not None and heard.type < 0 else role
    what = ("films?", WARN) if several and role == "films" else (word, ROLE_COLOURS[role])
    first: list[tuple[str, Colour]] = [what, (str(system_id), text), (plain(name), BRIGHT)]
    if heard is None:
        return [*first, ("not heard", WARN), ("", text), ("", text), ("", text)]
    refused = heard.auth > Auth.GOOD
    return [
        *first,
        (heard.kind, text),
        (heard.maker or "–", text),
        _position(heard),
        (heard.trust, ALARM if refused else INK if heard.auth is Auth.GOOD else text),
    ]


def _position(heard: HeardVehicle) -> tuple[str, Colour]:
    """Words for its rate, or for how long it has been silent."""
    if not heard.positions:
        return "none", WARN
    silent_s = (now_us() - heard.positions[-1]) * 1e-6
    if silent_s > SILENT_S:
        return f"lost {age(silent_s)}", ALARM
    return (f"{heard.position_hz:.0f}/s" if heard.position_hz >= 1 else "yes"), INK


def _standing(roles: Mapping[int, Role]) -> tuple[str, bool]:
    """Words for what is still to be done before a flight; and whether that is nothing."""
    films = [i for i, role in roles.items() if role == "films"]
    named = [i for i, role in roles.items() if role == "named"]
    if not roles:
        return "Nobody is heard yet: have the vehicles send their telemetry here.", False
    if len(films) > 1:
        return f"{len(films)} aircraft: pick the one that films, and press f.", False
    if not films:
        return "No aircraft films: pick the one that does, and press f.", False
    if not named:
        return "No ground vehicle is named: one that is heard is taken in by space.", False
    return f"enter flies: vehicle {films[0]} films, {len(named)} {'is' if len(named) == 1 else 'are'} named.", True
