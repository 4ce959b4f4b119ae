"""``gcs sim``: a simulated flight, as a session folder or live over the network."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import AsJson, check_range, print_json, print_lines, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError
from infra.secrets import concealed
from sim.fleet_process import read_keys
from sim.live import play
from sim.practice import TROUBLES
from sim.session import write_session
from sim.world.presets import PRESETS, preset
from sim.world.scenario import MAX_VIEWS, UAV_ID, Scenario
from sim.world.scenario_file import load_scenario


def sim(
    scenario: Annotated[str, typer.Argument(help=f"A scenario file, or one of {', '.join(PRESETS)}.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Session folder to write; else one named as the scenario.")
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Render the video instead of ideal detections.")] = False,
    live: Annotated[bool, typer.Option("--live", help="Play in real time over UDP.")] = False,
    telemetry: Annotated[str, typer.Option(help="Where --live sends MAVLink.")] = "udpout:127.0.0.1:14550",
    stream: Annotated[
        str, typer.Option(help="Where --live sends MPEG-TS video, a second camera's to the next port; empty for none.")
    ] = "udp://127.0.0.1:5600",
    truth: Annotated[Path | None, typer.Option(help="File for the true boxes that --live shows.")] = None,
    tells_camera: Annotated[
        bool, typer.Option("--camera/--no-camera", help="Have the UAV of --live report its camera and video.")
    ] = True,
    practise: Annotated[
        int,
        typer.Option(
            callback=check_range(0, 65535),
            metavar="PORT",
            help="With --live: UDP port of this computer that takes troubles to begin and end, such as 'battery 12': "
            f"{', '.join(TROUBLES)}. gcs fly --practise PORT has them by a key.",
        ),
    ] = 0,
    sign: Annotated[
        Path | None,
        typer.Option(metavar="KEYS", help="With --live: key file for all vehicles, or a folder as gcs keys makes it."),
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Length of the flight, instead of the scenario's.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all random numbers, instead of the scenario's.")] = None,
    views: Annotated[
        int | None,
        typer.Option(
            callback=check_range(1, MAX_VIEWS),
            help="Number of cameras, each from another side, instead of the scenario's.",
        ),
    ] = None,
    masts: Annotated[
        int,
        typer.Option(
            callback=check_range(0, MAX_VIEWS - 1),
            metavar="NUMBER",
            help="Number of --views, the last, that are on masts.",
        ),
    ] = 0,
    as_json: AsJson = False,
) -> None:
    """Simulate a flight with truth: write a session, or play it live for ``gcs fly``."""
    world = _scenario(scenario, duration, seed)
    if masts >= (views or 1):
        raise GcsError(f"--masts {masts}: the first camera flies, so that --views has to be more")
    if views is not None:
        world = world.filmed_by(views, masts)
    if not live:
        folder = out or Path(Path(scenario).stem)
        with progress("sim") as report:
            write_session(world, folder, video=video, report=report)
        seen = f", seen by {len(world.views) + 1} cameras" if world.views else ""
        print_note(f"{world.duration_s:g} s with {len(world.ugv_ids)} vehicles{seen} written to {folder}")
        return
    if out is not None:
        raise GcsError("--live writes no folder; leave --out away, and record with gcs fly")
    video_to = f", video to {concealed(stream)}" if stream else ""
    aircraft = [UAV_ID + k for k in range(len(world.views) + 1)]
    keys = read_keys(sign, (*aircraft, *world.ugv_ids)) if sign else None
    print_note(f"preparing {world.name} for {world.duration_s:g} s: MAVLink to {concealed(telemetry)}{video_to}")
    with progress("sim") as report:
        sent = play(
            world,
            telemetry,
            stream or None,
            truth_path=truth,
            on_tick=lambda s: report(int(s), int(world.duration_s)),
            tells_camera=tells_camera,
            practise_port=practise,
            keys=keys,
        )
    if as_json:
        print_json(asdict(sent))
        return
    print_table(
        ("system", "packets sent"), ((str(i), str(n)) for i, n in sent.packets.items()), right=("packets sent",)
    )
    print_lines(
        f"{sum(sent.packets.values())} packets and {sent.frames} frames sent, {sent.frames_skipped} frames skipped"
    )


def _scenario(name: str, duration: float | None, seed: int | None) -> Scenario:
    path = Path(name)
    chosen = load_scenario(path) if path.suffix == ".toml" else preset(name)
    if duration is not None:
        chosen = replace(chosen, duration_s=duration)
    return chosen if seed is None else replace(chosen, seed=seed)
