"""First contact, which a flight begins with: a mission file, or else who is heard, reported while it is listened to."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from gcs.cli.attach.client import naming_own_flight
from gcs.cli.output.console import CONSOLE, print_note, redirect_stderr
from gcs.cli.screen_options import ThemeName
from gcs.errors import GcsError
from gcs.flight.devices import cameras, serial_links
from gcs.flight.listening import HEARD_VIDEO, USUAL_LINKS, Listening, usual_links
from gcs.flight.video import AUTO, IF_OFFERED
from gcs.mission.mission import Links, Mission, SigningChoice, keys_folder, load_mission
from gcs.mission.roster import FleetChoice, HeardVehicle, Role, mission_of, proposed_roles
from gcs.mission.terrain_file import TerrainFile
from gcs.mission.tile_file import TileFile
from gcs.mission.written import MISSION_FILE
from infra.files.safe_open import is_shared
from infra.plain_text import plain
from infra.processes.end_signals import AskedBySignals
from infra.secrets import concealed
from mavlink.errors import LinkError
from mavlink.forwarding.outputs import parse_output
from vision.stream.port import are_one_place
from vision.stream.source import parse_source

STOPPED = 130
"""Exit code of who was interrupted before anything flew, as shells have it."""

SETTLED_S = 3.0
"""Time with nothing new after which everybody has been heard, s: positions and heartbeats come at least once a
second."""
TURN_S = 0.2
TELL_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Choices of the command line for a flight without a mission file."""

    links: tuple[str, ...]
    """Empty: the usual ports."""
    videos: tuple[str, ...]
    """Videos of the cameras, in the mission's order; empty: what the mission says, else what is offered or heard."""
    uav: int | None
    """System id of the aircraft that films; None: as heard."""
    ugv: tuple[int, ...]
    """Ground vehicles of the fleet by the command line; empty: as heard."""
    forward: tuple[str, ...]
    """Addresses that packets go on to."""
    accept_late: tuple[int, ...]
    sessions: Path
    listen_s: float

    @property
    def video(self) -> str | None:
        """Video of the first camera, None: not given."""
        return next(iter(self.videos), None)

    @property
    def chosen(self) -> dict[int, Role]:
        """Roles that are not a matter of what is heard."""
        films: dict[int, Role] = {} if self.uav is None else {self.uav: "films"}
        return films | dict.fromkeys(self.ugv, "named")

    @property
    def complete(self) -> bool:
        """True if nothing has to be heard first."""
        return self.uav is not None and bool(self.ugv) and self.video is not None

    def roles(self, vehicles: Iterable[HeardVehicle]) -> dict[int, Role]:
        """The role of each: with a fleet that is named, no other ground vehicle is in it."""
        return proposed_roles(vehicles, self.chosen, whole_fleet=not self.ugv)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """Mission and links with which a flight begins, from a mission file or from what was heard."""

    mission: Mission
    links: tuple[str, ...]
    video: str
    forward: tuple[str, ...]
    spare: tuple[str, ...] = ()
    """Links on which nobody of the mission was heard, and that nobody asked for."""
    origins: Mapping[str, str] = field(default_factory=dict)
    """Sources of the parts of the mission."""
    listening: Listening | None = None


def parse_ids(texts: Sequence[str]) -> tuple[int, ...]:
    """System ids, in order and each once: ``11-17``, ``11,13-15``.

    Raises:
        GcsError: something else, or no system id.
    """
    ids: list[int] = []
    for part in (part.strip() for text in texts for part in text.split(",")):
        first, dash, last = part.partition("-")
        ends = (first, last if dash else first)
        if not all(end.isascii() and end.isdigit() and 1 <= int(end) <= 255 for end in map(str.strip, ends)):
            raise GcsError(f"--ugv {part}: give system ids from 1 to 255, as 11-17 or 11,13-15")
        if int(ends[0]) > int(ends[1]):
            raise GcsError(f"--ugv {part}: give the lower id first")
        ids += range(int(ends[0]), int(ends[1]) + 1)
    return tuple(dict.fromkeys(ids))


def prepare(
    mission: Path | None,
    wanted: Wanted,
    asked: AskedBySignals,
    ending: contextlib.ExitStack,
    *,
    command: bool,
    screen: bool,
    ask: ThemeName | None,
) -> Ready:
    """Beginning by a mission file, else by who is heard; the command line in place of both.

    Args:
        ending: closes what is opened, unless a flight has it by then.
        command: whether the flight may send.
        screen: whether the flight has screens.
        ask: colours of the screen that asks who flies; None: nobody is asked.

    Raises:
        LinkError, GcsError: it cannot be used, nobody is heard, or it is not clear who films.
        SystemExit: interrupted.
    """
    if mission is None:
        if len(wanted.videos) > 1:
            raise GcsError("several --video are for a mission file with a [[view]] for each further camera")
        with naming_own_flight(wanted.links or USUAL_LINKS):
            listening = _listen(wanted, command=command)
        ending.callback(listening.close)
        if ask and not wanted.complete:
            found = _ask_who_flies(listening, wanted, asked, ask)
        else:
            found = _find_fleet(listening, wanted, asked)
        if found is None:
            raise SystemExit(STOPPED)
        return _ready(found, listening, wanted)
    if wanted.chosen:
        raise GcsError("--uav and --ugv are for flights without a mission file; the file has who flies")
    loaded = _with_videos(load_mission(mission), wanted.videos, mission)
    links = wanted.links or loaded.links.telemetry
    if not links:
        raise GcsError("no telemetry link; give --link (for example --link 14550) or [links] telemetry in the mission")
    if screen and loaded.tiles is not None:
        TileFile(loaded.tiles).close()
    if loaded.terrain is not None:
        TerrainFile(loaded.terrain)
    return Ready(
        mission=loaded,
        links=links,
        video=loaded.links.video if wanted.video is None else wanted.video,
        forward=wanted.forward or _checked_outputs(mission, loaded.links.forward, command=command),
        origins={"": f"As {mission.name} has it, and what changed in flight; docs/mission.md has every key."},
    )


def _with_videos(mission: Mission, videos: Sequence[str], path: Path) -> Mission:
    """Return the mission with the further cameras' videos of the command line, where it has them.

    Raises:
        GcsError: there are more than cameras, or two cameras have one.
        VideoError: one is none.
    """
    if len(videos) > len(mission.view) + 1:
        raise GcsError(f"{len(videos)} times --video; {path} has {len(mission.view)} [[view]] beside the first camera")
    further = dict(enumerate(videos[1:]))
    views = tuple(replace(view, video=further.get(k, view.video)) for k, view in enumerate(mission.view))
    every = [next(iter(videos), mission.links.video), *(view.video for view in views)]
    sources = [parse_source(video) for video in every if video not in ("", AUTO)]
    for one, other in itertools.combinations(sources, 2):
        if are_one_place(one, other):
            raise GcsError(f"{one.text} and {other.text} are one place for two cameras' video; give each its own")
    return replace(mission, view=views)


def _listen(wanted: Wanted, *, command: bool) -> Listening:
    """Open the links, and tell which ports are others'.

    Raises:
        LinkError, SessionError: they cannot be opened.
    """
    links, taken = (wanted.links, ()) if wanted.links else usual_links()
    if Path(MISSION_FILE).is_file():
        print_note(f"{MISSION_FILE} is here, and not used: gcs fly {MISSION_FILE} flies it")
    listening = Listening(
        links,
        wanted.sessions,
        SigningChoice(keys=keys_folder()),
        forward=wanted.forward,
        command=command,
        accept_late=wanted.accept_late,
        for_video=wanted.video is None,
        troubles=taken,
    )
    for text in listening.troubles:
        print_note(text)
    return listening


def _ask_who_flies(listening: Listening, wanted: Wanted, asked: AskedBySignals, theme: ThemeName) -> FleetChoice | None:
    """The start screen; None where it was left without a flight."""
    # The screens are slow to import, and headless flights do without.
    from gcs.tui import run_start

    with redirect_stderr(listening.folder / CONSOLE):
        return run_start(
            listening,
            wanted.chosen,
            whole_fleet=not wanted.ugv,
            video=wanted.video,
            theme=theme,
            to_end=lambda: asked.to_end,
            hung_up=lambda: asked.hung_up,
        )


def _find_fleet(listening: Listening, wanted: Wanted, asked: AskedBySignals) -> FleetChoice | None:
    """Listen without a screen until an aircraft and a fleet report their positions and nothing new comes.

    What is heard is reported once a second at most. None: a signal asks to end.

    Raises:
        LinkError: nothing is heard.
        GcsError: it is not clear who films, or nobody is to be named.
    """
    began_s, shown_s, shown = time.monotonic(), 0.0, ""
    if not wanted.complete:
        print_note(f"listening on {listening.where}")
    while not wanted.complete:
        if asked.to_end:
            return None
        listening.poll(TURN_S)
        now_s = time.monotonic()
        text = _heard_text(listening)
        if text != shown and now_s - shown_s >= TELL_S:
            shown, shown_s = text, now_s
            print_note(text)
        if now_s - began_s >= wanted.listen_s or (listening.quiet_s >= SETTLED_S and _all_report(listening, wanted)):
            break
    vehicles = listening.roster.vehicles
    roles = wanted.roles(vehicles)
    if not vehicles and not (wanted.uav and wanted.ugv):
        raise LinkError(
            f"nothing is heard on {listening.where} in {wanted.listen_s:g} s: have the vehicles send there, or name "
            f"another link: gcs fly -l {next(iter(serial_links()), '/dev/ttyUSB0,57600')}"
        )
    mission_of(roles)
    silent = [str(i) for i, role in roles.items() if role != "out" and i not in _reporting(listening)]
    if silent and not wanted.complete:
        print_note(f"no position yet of {', '.join(silent)}")
    return FleetChoice(roles=roles, chosen=frozenset(wanted.chosen), video=wanted.video)


def _heard_text(listening: Listening) -> str:
    """Everybody who is heard, in one line."""
    vehicles = [
        f"{each.system_id} {each.kind}{'' if each.positions else ' without position'}"
        + ("" if each.auth <= 1 else f" ({each.trust})")
        for each in listening.roster.vehicles
    ]
    video = "video is offered" if listening.offer else "video is heard" if listening.hears_video else "no video yet"
    return f"heard: {', '.join(vehicles) or 'nobody'}; {video}"


def _ready(found: FleetChoice, listening: Listening, wanted: Wanted) -> Ready:
    """The flight of those who were found.

    Raises:
        GcsError: it is not clear who films, or nobody is to be named.
    """
    heard_on = {each.link for each in listening.roster.vehicles if found.roles.get(each.system_id, "out") != "out"}
    ours = tuple(link for k, link in enumerate(listening.links) if wanted.links or k in heard_on) or listening.links
    video, video_from = _video(listening, found)
    mission = replace(
        mission_of(found.roles, found.names),
        links=Links(telemetry=ours, video=AUTO if video == IF_OFFERED else video, forward=wanted.forward),
        signing=SigningChoice(keys=keys_folder()),
    )
    links_from = "as given by --link" if wanted.links else "where it was heard"
    return Ready(
        mission=mission,
        links=listening.links,
        video=video,
        forward=wanted.forward,
        spare=tuple(link for link in listening.links if link not in ours),
        origins=_origins(mission, found, listening) | {"links": f"telemetry {links_from}; video {video_from}"},
        listening=listening,
    )


def _video(listening: Listening, found: FleetChoice) -> tuple[str, str]:
    """Address that video comes from, and why from there, for the operator."""
    if found.video is not None:
        return found.video, "as given"
    if listening.offer:
        print_note(f"video: the UAV offers {concealed(listening.offer)}")
        return AUTO, "as the UAV offers it"
    if listening.hears_video:
        print_note(f"video: heard at {HEARD_VIDEO}")
        return HEARD_VIDEO, "as it was heard"
    print_note(
        "no video is offered or heard: if the UAV offers one later it is shown; else end this flight and give its "
        f"address with --video, such as rtsp://192.168.1.10:8554/main or {_plugged_in()}"
    )
    return IF_OFFERED, 'was neither offered nor heard: "auto" takes what the UAV offers, else write its address here'


def _plugged_in() -> str:
    """A camera of this computer, with its name, or how one is written."""
    return next((f"{device} ({plain(name)})" for device, name in cameras().items()), "/dev/video0")


def _origins(mission: Mission, found: FleetChoice, listening: Listening) -> dict[str, str]:
    heard = {each.system_id: each for each in listening.roster.vehicles}
    origins = {
        "": f"Made by gcs fly at {datetime.now(UTC):%Y-%m-%d %H:%M}Z; docs/mission.md has every key.",
        "camera": "No [camera]: its numbers are those that the UAV reports, or found from the flight.",
        "detector": "as given by --model",
    }
    for system_id in (mission.uav.system_id, *mission.ugv_ids):
        each = heard.get(system_id)
        if each is None:
            origins[str(system_id)] = "chosen, and not heard"
            continue
        what = f"{each.maker} {each.kind}".strip()
        why = "chosen" if system_id in found.chosen else "by its heartbeats"
        origins[str(system_id)] = f"{what}, {why}; heard on {listening.links[each.link]}"
    return origins


def _reporting(listening: Listening) -> set[int]:
    return {each.system_id for each in listening.roster.vehicles if each.positions}


def _all_report(listening: Listening, wanted: Wanted) -> bool:
    """Tell whether one who films and one of the fleet report positions, and all who were named do."""
    roles, reporting = wanted.roles(listening.roster.vehicles), _reporting(listening)
    present = {role for i, role in roles.items() if i in reporting}
    return {"films", "named"} <= present and set(wanted.chosen) <= reporting


def _checked_outputs(mission: Path, forward: tuple[str, ...], *, command: bool) -> tuple[str, ...]:
    """The outputs of a mission file, whose author orders the UAV by them.

    Raises:
        GcsError: a program behind one may send, and others may write into the file.
    """
    asked = [out for out in forward if parse_output(out)[1] is not None]
    if command and asked and is_shared(mission):
        raise GcsError(
            f"{mission}: others may change this file, so {asked[0]} in it does not let a program send; "
            f"name it with --out, or make the file your own alone"
        )
    return forward
