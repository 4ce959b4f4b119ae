"""``gcs fly``: the live screen, or the same flight without one."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import math
import os
import resource
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.attach.client import naming_own_flight, show_flight
from gcs.cli.attach.server import AttachServer, LentTerminal
from gcs.cli.contact import Wanted, parse_ids, prepare
from gcs.cli.output.console import (
    CONSOLE,
    FAR_S,
    NO_NAMES,
    NOT_AVAILABLE,
    AsJson,
    check_range,
    check_terminal,
    print_json,
    print_lines,
    print_note,
    redirect_if_terminal_gone,
    redirect_stderr,
)
from gcs.cli.rollcall import print_rollcall, rollcall_json
from gcs.cli.screen_options import ScreenOptions, Ui, screen_options
from gcs.cli.sharing.publishing import Publish, Stream, parse_sinks, publishing
from gcs.errors import GcsError
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.mission.mission import Mission, unheeded_links
from gcs.report.rollcall import RollCall
from gcs.session.sealing import Sealing
from gcs.snapshot import Event, Snapshot
from infra.files.safe_open import is_shared
from infra.processes.end_signals import AskedBySignals, noted_signals
from infra.secrets import concealed, secrets_of
from infra.session_format import METADATA
from infra.wall_clock import now_us
from mavlink.forwarding.outputs import parse_output
from mavlink.state import Level

_log = logging.getLogger(__name__)

_STAT = Path("/proc/self/stat")
_ARG_START, _ARG_END = 47, 48
"""Fields of proc_pid_stat(5), from 0: where the arguments lie in memory, which is what ps shows."""

LOOK_S = 0.2
"""A flight without a screen looks this often whether it is to end or to be shown."""
MIN_FILES = 128
"""Open files and sockets: a flight with video has some fifty, and as many for clients, terminals and replacements."""
TAKEN_OVER = "another terminal has taken the screens over"


def fly(
    mission: Annotated[
        Path | None,
        typer.Argument(
            help="Mission file: vehicles, camera, clocks; without one, whoever is heard. With --attach a session "
            "folder, or nothing."
        ),
    ] = None,
    link: Annotated[list[str] | None, typer.Option("--link", "-l", help="Telemetry link; may be repeated.")] = None,
    video: Annotated[
        list[str] | None,
        typer.Option(
            "--video",
            "-v",
            help="Video URL, device or file; auto: what the UAV offers. Once more for each [[view]] of the mission.",
        ),
    ] = None,
    out: Annotated[
        list[str] | None,
        typer.Option(
            "--forward",
            help="Where packets go on to, untouched (udpout:127.0.0.1:14551); may be repeated. Programs there only "
            "listen; ?rw behind it lets them send to the UAV, ?rw=11 to vehicle 11 too (needs --command).",
        ),
    ] = None,
    uav: Annotated[
        int | None,
        typer.Option(
            callback=check_range(1, 255), metavar="ID", help="Without a mission file: the aircraft that films."
        ),
    ] = None,
    ugv: Annotated[
        list[str] | None,
        typer.Option(
            metavar="IDS", help="Without a mission file: who is named, as 11-17 or 11,13-15; may be repeated."
        ),
    ] = None,
    listen_s: Annotated[
        float,
        typer.Option(
            "--listen",
            callback=check_range(0.0, FAR_S),
            help="Without a mission file and a screen: seconds until who was heard has to do.",
        ),
    ] = 20.0,
    command: Annotated[
        bool, typer.Option("--command", help="May send to the UAV, and to it alone: heartbeat, message rates, orders.")
    ] = False,
    accept_late: Annotated[
        list[int] | None,
        typer.Option(
            "--accept-late",
            metavar="ID",
            help="Accept this vehicle's signatures without a proof that they are new; may be repeated.",
        ),
    ] = None,
    sessions: Annotated[Path, typer.Option(help="Folder for recordings.")] = Path("sessions"),
    model: Annotated[Path | None, typer.Option(help="ONNX detector instead of the mission's.")] = None,
    headless: Annotated[bool, typer.Option("--headless", help="No screen; roll call at the end.")] = False,
    duration: Annotated[
        float | None,
        typer.Option(callback=check_range(0.1, FAR_S), help="Stop after so many seconds; without a screen."),
    ] = None,
    ui: Ui = None,
    attach: Annotated[
        bool, typer.Option("--attach", help="Show the screens of your flight that is under way, on this terminal.")
    ] = False,
    take_over: Annotated[
        bool, typer.Option("--take-over", help="With --attach: from the terminal that shows them now.")
    ] = False,
    as_json: AsJson = False,
    publish: Publish = None,
    stream: Stream = None,
    practise: Annotated[
        int,
        typer.Option(
            callback=check_range(0, 65535),
            metavar="PORT",
            help="Port of gcs sim run --live --practise: X begins troubles.",
        ),
    ] = 0,
    serve: Annotated[bool, typer.Option("--serve", hidden=True)] = False,
) -> None:
    """Name the vehicles in a live video; record everything, and listen only unless --command is given."""
    if serve:
        raise GcsError(
            "a flight is never served; gcs fly --attach shows it on a terminal, gcs replay --serve a recording"
        )
    if attach:
        print_note(show_flight(mission, screen_options(ui), take_over=take_over))
        return
    _hide_passwords(video or ())
    wanted = Wanted(
        links=tuple(link or ()),
        videos=tuple(video or ()),
        uav=uav,
        ugv=parse_ids(ugv or ()),
        forward=tuple(out or ()),
        accept_late=tuple(accept_late or ()),
        sessions=sessions,
        listen_s=listen_s,
    )
    screen = not headless and sys.stdout.isatty() and sys.stdin.isatty()
    # what is wrong in the user's file ends no flight without a screen
    options = screen_options(ui) if screen or ui else ScreenOptions()
    _check(duration, screen=screen)
    # from here until the recording is sealed no signal interrupts anything
    with noted_signals() as asked, contextlib.ExitStack() as ending:
        ask = options.theme if screen and not as_json else None
        ready = prepare(mission, wanted, asked, ending, command=command, screen=screen, ask=ask)
        links, flown = ready.links, _with_model(ready.mission, model)
        sinks = parse_sinks(publish, stream, (*links, *ready.forward))
        plan = FlightPlan(
            mission=flown,
            links=links,
            video=ready.video,
            sessions=sessions,
            forward=ready.forward,
            command=command,
            accept_late=_check_vehicles(wanted.accept_late, flown),
            spare=ready.spare,
            origins=ready.origins,
            practise_port=practise,
        )
        seen = {place: RollCall(flown.views[place]) for place in plan.videos}
        calls = seen[0]
        calls.other_views = tuple(seen.values())[1:]

        def take(place: int, snapshot: Snapshot) -> None:
            seen[place].add_in_flight(snapshot)

        with naming_own_flight(links):
            flight = Flight(plan, take, ready.listening)
        ending.callback(flight.stop)
        ending.callback(_tell_start(flight, plan, mission, screen=screen).close)
        door = AttachServer(flight.folder, links)
        ending.callback(door.close)
        if not screen:
            print_note(_gone_on(flight, "recording" if headless else "no terminal, so no screen; recording", door))
        with publishing(flight, sinks, flight.folder.name, sessions, flight.latest_of_first):
            if not screen or not _screen(flight, calls, options, door, asked):
                _wait(flight, calls, door, asked, duration)
    if asked.hung_up:
        redirect_if_terminal_gone(flight.folder / CONSOLE)
    for place, frames in flight.frames.items():
        seen[place].set_frame_count(frames)
    if mission is None:
        _save_mission(flight)
    _report(flight, calls, as_json=as_json)
    if any(plan.videos.values()) and not any(each.named for each in seen.values()):
        raise SystemExit(NO_NAMES)


def _with_model(mission: Mission, model: Path | None) -> Mission:
    """Return the mission with another detector, where one is given."""
    if model is None:
        return mission
    return replace(mission, detector=replace(mission.detector, model=str(model.absolute())))


def _save_mission(flight: Flight) -> None:
    """Keep what flew without a mission file as one; where that fails the session has it all the same."""
    try:
        print_note(flight.save_mission())
    except OSError as error:
        print_note(f"the mission cannot be saved here ({error.strerror}); {flight.folder / METADATA} has it")


def _report(flight: Flight, calls: RollCall, *, as_json: bool) -> None:
    """Print how it went.

    Raises:
        SystemExit, BaseException: something could not be recorded, or what ended the flight.
    """
    if as_json:
        print_json({**rollcall_json(calls), "packets": flight.packets, "folder": str(flight.folder)})
    else:
        print_rollcall(calls)
        print_lines(f"{flight.packets} packets received; recorded in {flight.folder}")
    for line in (*flight.lost, *flight.faults):
        print_note(line)
    if flight.error:
        raise flight.error
    if flight.lost:
        raise SystemExit(NOT_AVAILABLE)


def _hide_passwords(videos: Sequence[str]) -> None:
    """Take passwords on the command line from the list of processes, where they stood until now."""
    for video in (secret := [*filter(secrets_of, videos)]):
        hide_in_process_list(video, secrets_of(video))
    if secret:
        print_note(
            "other users could see the password or key in --video for a moment; [links] video in a mission is safer, "
            "and a further camera's [[view]] video"
        )


def hide_in_process_list(argument: str, secrets: Iterable[str]) -> None:
    """Overwrite parts of an argument where the system keeps it, for ps and the like; Python's copies stay as they are.

    On systems without /proc nothing is done.

    Args:
        argument: as it was given, or the value in ``--option=value``.
    """
    try:
        # the second field is a name in brackets and may hold spaces
        fields = ["", "", *_STAT.read_text().rpartition(")")[2].split()]
        start, end = int(fields[_ARG_START]), int(fields[_ARG_END])
    except (OSError, ValueError, IndexError):
        return
    if not 0 < start < end:
        return
    line, wanted = ctypes.string_at(start, end - start), os.fsencode(argument)
    place = line.find(wanted)
    while place >= 0:
        for secret in map(os.fsencode, secrets):
            at = wanted.find(secret)
            while at >= 0:
                ctypes.memset(start + place + at, ord("*"), len(secret))
                at = wanted.find(secret, at + 1)
        place = line.find(wanted, place + 1)


def _tell_start(flight: Flight, plan: FlightPlan, mission: Path | None, *, screen: bool) -> Sealing:
    """Seal interrupted recordings, and tell where packets go, what in the mission does not count, and which folders
    others may write to: in the flight's events, and on stderr where there is no screen."""

    def report(text: str, level: Level = "info") -> None:
        flight.add_event(Event(t_us=now_us(), level=level, kind="recording", text=text))
        if not screen:
            print_note(text)

    for out in plan.forward:
        url, named = parse_output(out)
        ids = "".join(f" and {plan.mission.name_of(i)}" for i in sorted(named or ()))
        may = "programs there only listen" if named is None else f"programs there may send to the UAV{ids}"
        report(f"packets go on to {url}; {may}", "info" if named is None else "warning")
    if keyless := flight.without_key:
        names = ", ".join(f"{plan.mission.name_of(i)} ({i})" for i in keyless)
        report(
            f"{plan.mission.signing.folder} has no key for {names}: what they send is refused; "
            'make keys with gcs keys, or set [signing] keys = "none"',
            "warning",
        )
    if mission is not None and (unheeded := unheeded_links(mission)):
        addresses = ", ".join(map(concealed, unheeded))
        report(
            f"{mission} came with a recording: its links do not count ({addresses}); give --link, --video, --out",
            "warning",
        )
    for view in plan.mission.view:
        if not view.video:
            name = plan.mission.name_of(view.system_id)
            report(
                f"{name} has no video, so its camera is left out: [[view]] video or one more --video adds it", "warning"
            )
    for folder in filter(is_shared, (flight.folder, plan.sessions)):
        report(
            f"{folder}: others may write to this folder, and change what is recorded; chmod go-w ends that", "warning"
        )
    return Sealing(plan.sessions, report)


def _check_vehicles(system_ids: Sequence[int], mission: Mission) -> tuple[int, ...]:
    """Vehicles of the mission.

    Raises:
        GcsError: one of these is none.
    """
    known = mission.system_ids
    for system_id in system_ids:
        if system_id not in known:
            raise GcsError(f"--accept-late {system_id}: no vehicle of the mission; it has {', '.join(map(str, known))}")
    return tuple(system_ids)


def _check(duration: float | None, *, screen: bool) -> None:
    if screen and duration is not None:
        raise GcsError("--duration is for flights without a screen; add --headless")
    if screen:
        check_terminal("gcs fly --headless flies without them")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= soft < MIN_FILES:
        wanted = MIN_FILES if hard == resource.RLIM_INFINITY else min(MIN_FILES, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        if wanted < MIN_FILES:
            raise GcsError(f"only {hard} files may be open, and a flight needs {MIN_FILES}: see ulimit -n")


def _gone_on(flight: Flight, why: str, door: AttachServer) -> str:
    shown = door.trouble or "gcs fly --attach shows it on any terminal"
    return f"{why} in {flight.folder}: stop with Ctrl-C, or kill {os.getpid()}; {shown}"


def _wait(
    flight: Flight, calls: RollCall, door: AttachServer, asked: AskedBySignals, duration: float | None = None
) -> None:
    """Wait until the time is over or a signal to end comes; show the screens on terminals that are attached meanwhile.

    A flight outlives the terminal that it was started on.
    """
    end_s = math.inf if duration is None else time.monotonic() + duration
    while not asked.to_end and time.monotonic() < end_s:
        if asked.hung_up:
            asked.hung_up = False
            redirect_if_terminal_gone(flight.folder / CONSOLE)
        if (lent := door.take()) is None:
            time.sleep(LOOK_S)
        elif _lend(flight, calls, lent, door, asked, end_s):
            break


def _screen(flight: Flight, calls: RollCall, options: ScreenOptions, door: AttachServer, asked: AskedBySignals) -> bool:
    """Fly with the screens; whether the flight is to end with them."""
    with redirect_stderr(flight.folder / CONSOLE), door.showing():
        ended = _run(flight, calls, options, asked, lambda: asked.hung_up or door.taken_over())
    if not ended:
        redirect_if_terminal_gone(flight.folder / CONSOLE)
        why = TAKEN_OVER if door.taken_over() else "the screen is gone"
        print_note(_gone_on(flight, f"{why}; still recording", door))
    return ended


def _lend(
    flight: Flight, calls: RollCall, lent: LentTerminal, door: AttachServer, asked: AskedBySignals, end_s: float
) -> bool:
    """Show the screens on another terminal; whether the flight is to end, which no terminal decides by failing."""
    ended = False
    try:
        with lent.as_standard_streams(), door.showing():
            ended = _run(flight, calls, lent.options, asked, lambda: door.taken_over() or time.monotonic() >= end_s)
    except Exception:  # noqa: BLE001 - logged; a terminal may never end a flight
        _log.exception("a terminal that was attached failed")
    over = ended or asked.to_end or time.monotonic() >= end_s
    goes_on = f"{TAKEN_OVER}; the flight goes on" if door.taken_over() else "the flight goes on"
    lent.give_back("the flight has ended" if over else f"{goes_on}; gcs fly --attach shows it again")
    return ended


def _run(
    flight: Flight, calls: RollCall, options: ScreenOptions, asked: AskedBySignals, hung_up: Callable[[], bool]
) -> bool:
    """The screens, until they are left: whether to end the flight."""
    # The screens are slow to import, and headless flights do without.
    from gcs.tui import run

    try:
        return run(
            flight,
            options.graphics,
            bell=options.bell,
            theme=options.theme,
            fps=options.fps,
            calls=calls,
            to_end=lambda: asked.to_end,
            hung_up=hung_up,
        ).left
    except Exception:  # noqa: BLE001 - logged; a screen may never end a flight
        _log.exception("the screens failed")
        return False
