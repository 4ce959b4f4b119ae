"""``gcs doctor``: what this machine has for a flight, and with a mission whether its vehicles, video and camera do."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FAR_S, AsJson, check_range, print_json, print_note
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.fold.detector_factory import open_mission_detector
from gcs.health.detector_speed import ground_sampling
from gcs.health.machine import PORTS, checks
from gcs.health.preflight import Check, of_its_camera, preflight
from gcs.mission.mission import Mission, load_mission
from gcs.station import Station

NOT_READY = 2
LOOK_S = 0.5
SETTLED_S = 8.0
"""Time after which what is well stays so: rates are measured over three seconds, and low ones told after five."""
_SMALLEST = (80, 24)
_MARKS = {"ok": "ok", "short": "short", "bad": "BAD"}


def doctor(
    sessions: Annotated[Path, typer.Option(help="Where flights are recorded.")] = Path("sessions"),
    mission: Annotated[
        Path | None, typer.Option("--mission", help="Mission file: listen to its vehicles, too, and nothing is kept.")
    ] = None,
    link: Annotated[
        list[str] | None, typer.Option("--link", "-l", help="Telemetry link instead of the mission's; may be repeated.")
    ] = None,
    video: Annotated[str | None, typer.Option("--video", "-v", help="Video instead of the mission's.")] = None,
    height: Annotated[
        float | None,
        typer.Option(
            callback=check_range(1.0, 5000.0), help="Planned height above the ground, m, for the detector's speed."
        ),
    ] = None,
    listen_s: Annotated[
        float, typer.Option("--listen", callback=check_range(0.0, FAR_S), help="With --mission: seconds, at most.")
    ] = 20.0,
    command: Annotated[
        bool, typer.Option("--command", help="With --mission: ask the UAV for the message rates that names need.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show what this machine has and, with a mission, whether a flight has what it needs; and what to do."""
    if mission is None:
        if link or video is not None or command:
            raise GcsError("--link, --video and --command are about a flight: give --mission, too")
        found = [*checks(sessions, gsd_m=_gsd_m(None, height)), _terminal()]
    else:
        flown = load_mission(mission)
        opened = partial(open_mission_detector, flown.detector, threads=os.cpu_count() or 1)
        ports = () if link or flown.links.telemetry else PORTS
        gsd_m, cameras = _gsd_m(flown, height), len(flown.views)
        found = [*checks(sessions, ports, gsd_m=gsd_m, open_detector=opened, cameras=cameras), _terminal()]
        found += _listen(_with_links(flown, link, video), listen_s, command=command)
    if as_json:
        print_json({"checks": [asdict(check) for check in found]})
    else:
        print_table(("verdict", "check", "found"), (row for check in found for row in _rows(check)), head=False)
    if any(check.verdict == "bad" for check in found):
        raise SystemExit(NOT_READY)


def _with_links(mission: Mission, link: list[str] | None, video: str | None) -> Mission:
    """Return the mission with the links of the command line in place of its own.

    Raises:
        GcsError: there is no link.
    """
    links = replace(
        mission.links,
        telemetry=tuple(link or ()) or mission.links.telemetry,
        video=mission.links.video if video is None else video,
    )
    if not links.telemetry:
        raise GcsError("no telemetry link; give --link (for example --link 14550) or [links] telemetry in the mission")
    return replace(mission, links=links)


def _gsd_m(mission: Mission | None, height_m: float | None) -> float | None:
    """Ground metres a pixel straight below, at the planned height, None unknown."""
    camera = mission.camera.intrinsics if mission and mission.camera else None
    if height_m is None or camera is None:
        return None if height_m is None else ground_sampling(height_m)
    return height_m / camera.fx


def _listen(mission: Mission, listen_s: float, *, command: bool) -> tuple[Check, ...]:
    """Fly with the mission until all is well or the time is over; what was recorded is deleted.

    Raises:
        LinkError, ModelError, VideoError: something cannot be opened.
    """
    links = mission.links
    print_note(f"listening on {', '.join(links.telemetry)} for {listen_s:g} s at most; nothing is kept")
    with tempfile.TemporaryDirectory() as folder:
        plan = FlightPlan(
            mission=mission, links=links.telemetry, video=links.video, sessions=Path(folder), command=command
        )
        flight = Flight(plan)
        try:
            began_s, found = time.monotonic(), tuple[Check, ...]()
            while (waited_s := time.monotonic() - began_s) < listen_s:
                time.sleep(LOOK_S)
                found = _of_all_cameras(flight, len(plan.videos))
                if waited_s >= SETTLED_S and found and all(check.verdict == "ok" for check in found):
                    break
            return found
        finally:
            flight.stop()


def _of_all_cameras(station: Station, cameras: int) -> tuple[Check, ...]:
    """Checks of a flight, by what each of its cameras shows; nothing before all have shown anything."""
    found = list[Sequence[Check]]()
    for place in range(cameras):
        if (now := station.latest()) is not None:
            needed = preflight(now, station.rates())
            found.append(of_its_camera(needed, now.vehicles[0].name) if place else needed)
        station = station.next_view() or station  # once round
    return tuple(chain.from_iterable(found)) if len(found) == cameras else ()


def _rows(check: Check) -> Iterator[tuple[str, str, str]]:
    yield _MARKS[check.verdict], check.name, check.found
    if check.advice:
        yield "", "", f"→ {check.advice}"


def _terminal() -> Check:
    from gcs.tui.draw.pixels import picture_mode, pixel_images
    from gcs.tui.draw.terminal_kind import has_terminal

    if not has_terminal():
        return Check(
            name="terminal", verdict="short", found="none here", advice="screens need one; --headless flies without"
        )
    columns, rows = shutil.get_terminal_size()
    colours = "16 million colours" if os.environ.get("COLORTERM") in ("truecolor", "24bit") else "256 colours or fewer"
    grain = picture_mode("auto", None).grain
    images = "images as " + ("pixels" if pixel_images("pixels") else "half blocks" if grain == "halves" else grain)
    found = f"{columns}×{rows}, {colours}, {images}"
    if columns < _SMALLEST[0] or rows < _SMALLEST[1]:
        return Check(name="terminal", verdict="short", found=found, advice="make it 80×24 at least")
    return Check(name="terminal", verdict="ok", found=found)
