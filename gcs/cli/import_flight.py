"""``gcs import``: a flight that others recorded as a session."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from gcs.cli.output.console import AsJson, as_typed, check_range, print_json, print_note
from gcs.cli.output.tables import print_table
from gcs.errors import GcsError
from infra.text_numbers import number_or_nan

FARTHEST_CLOCK_S = 1e9
"""Thirty years: the clock of a camera that was never set."""


def import_flight(
    out: Annotated[Path, typer.Option("--out", "-o", help="Session folder to write.")],
    video: Annotated[Path, typer.Option(help="The film.")],
    uav: Annotated[
        Path | None,
        typer.Option(
            help="Log of the UAV that filmed: .srt (DJI), .bin, .log, .ulg, .tlog, .csv and others; a mast's .toml."
        ),
    ] = None,
    ugv: Annotated[
        list[str] | None,
        typer.Option(
            help="Log of a ground vehicle, as 11=rover.bin (.ulg, .tlog, .csv, .gpx, .kml, .nmea …); repeatable."
        ),
    ] = None,
    view: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILM[=LOG]",
            help="Film of another aircraft of the same flight, and its log where the film has none; of a camera on a "
            "mast the TOML file with its [mast]; may be repeated.",
        ),
    ] = None,
    tlog: Annotated[
        Path | None, typer.Option(help="Telemetry log with the ground vehicles, and perhaps the UAV.")
    ] = None,
    clock: Annotated[
        str,
        typer.Option(help="Seconds that the fleet's clock is ahead of the film's, as +3.5; auto: searched for."),
    ] = "auto",
    clock_within: Annotated[
        float | None,
        typer.Option(
            callback=check_range(1.0, FARTHEST_CLOCK_S),
            help="Largest difference of the clocks to search; default: any.",
        ),
    ] = None,
    fov: Annotated[
        float | None,
        typer.Option(callback=check_range(2.0, 170.0), help="Horizontal field of view; default: from the logs."),
    ] = None,
    lens: Annotated[Path | None, typer.Option(help="Lens file, as gcs calibrate writes.")] = None,
    camera: Annotated[str, typer.Option(help="Name of a known camera, for its field of view: docs/import.md.")] = "",
    pitch: Annotated[
        float | None,
        typer.Option(
            callback=check_range(-90.0, -5.0), help="Camera pitch (-90 is straight down); default: from the logs."
        ),
    ] = None,
    mount: Annotated[
        Literal["stabilized", "fixed", "gimbal"] | None,
        typer.Option(help="How the camera is mounted; default: from the logs."),
    ] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Explain each file: its clock, what was read, assumed and left out.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write a session from a flight that others recorded: film, logs, tables."""
    # decoder and readers are loaded only where they are needed: that takes time
    from gcs.importing.camera_choice import CameraOptions
    from gcs.importing.importer import FurtherFilm, ImportOptions
    from gcs.importing.importer import import_flight as import_files

    options = ImportOptions(
        video=video,
        uav=uav,
        ugv=tuple(ugv or ()),
        tlog=tlog,
        clock_s=_clock_s(clock),
        clock_within_s=math.inf if clock_within is None else clock_within,
        views=tuple(FurtherFilm(**files) for files in map(_film_and_log, view or ())),
        camera=CameraOptions(fov_deg=fov, lens=lens, model=camera, pitch_deg=pitch, mount=mount),
    )
    report = import_files(out, options)
    if as_json:
        print_json({**report.table(), "uav": report.uav_id, "ugv": list(report.ugv_ids), "folder": str(out)})
        return
    print_table(("what", "how"), report.explained() if explain else report.rows(), head=False)
    print_note(f"wrote {out}; next: gcs identify {as_typed(out)} -o {as_typed(f'{out}-names')}")


def _film_and_log(text: str) -> dict[str, Path]:
    film, named, log = text.rpartition("=")
    return {"video": Path(film), "uav": Path(log)} if named and not Path(text).exists() else {"video": Path(text)}


def _clock_s(text: str) -> float | None:
    """Seconds, None for auto."""
    if text == "auto":
        return None
    seconds = number_or_nan(text)
    if not abs(seconds) <= FARTHEST_CLOCK_S:
        raise GcsError(
            f"--clock {text}: give auto, or seconds such as +3.5 from {-FARTHEST_CLOCK_S:g} to {FARTHEST_CLOCK_S:g}"
        )
    return seconds
