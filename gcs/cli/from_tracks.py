"""``gcs sim from-tracks``: an annotated film from a public data set as a session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from gcs.cli.output.console import AsJson, as_typed, check_range, print_json, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table

MAX_NUMBER = 2**63 - 1
"""Largest number of frames, vehicles and seeds."""
MAX_TEAM = 200
"""Vehicles that the simulator has report."""


def from_tracks(
    tracks: Annotated[
        Path,
        typer.Argument(help="Labels: MOT Challenge, VisDrone, UAVDT-M, or a CSV with the corners of boxes (DRIFT)."),
    ],
    video: Annotated[Path, typer.Option(help="The film: a video file, or a folder of numbered images.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Session folder to write.")],
    layout: Annotated[
        Literal["auto", "csv", "mot", "visdrone", "uavdt"], typer.Option(help="Layout of the labels.")
    ] = "auto",
    first_frame: Annotated[
        int | None,
        typer.Option(
            help="Number of the first image in the labels; else 0 for csv, 1 for others.", min=0, max=MAX_NUMBER
        ),
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(
            callback=check_range(0.5, 120.0), help="Numbered images per second; default: as in seqinfo.ini, or 30."
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(callback=check_range(0.1, 7200.0), help="Length to use; default: the whole film.")
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(callback=check_range(3.0, 500.0), help="Height above the ground; default: from the cars' size."),
    ] = None,
    fov: Annotated[
        float | None,
        typer.Option(callback=check_range(5.0, 150.0), help="Horizontal field of view; default: 65."),
    ] = None,
    pitch: Annotated[
        float | None,
        typer.Option(
            callback=check_range(-90.0, -10.0),
            help="Camera pitch (-90 is straight down); default: from how the cars' size changes down the image.",
        ),
    ] = None,
    static: Annotated[bool, typer.Option("--static", help="Assume that the camera does not move.")] = False,
    team: Annotated[
        int, typer.Option(help="How many are ours: the longest seen, moving ones first.", min=1, max=MAX_TEAM)
    ] = 6,
    vehicle: Annotated[
        list[int] | None,
        typer.Option(help="Number of one of ours in the labels, instead of --team; repeatable.", min=0, max=MAX_NUMBER),
    ] = None,
    errors: Annotated[Literal["standard", "hard"], typer.Option(help="Errors of the reported positions.")] = "standard",
    boxes: Annotated[
        Literal["film", "labels"], typer.Option(help="What is named: what is detected in the film, or the labels.")
    ] = "film",
    seed: Annotated[int, typer.Option(help="Seed of the random errors.", min=0, max=MAX_NUMBER)] = 1,
    as_json: AsJson = False,
) -> None:
    """Put telemetry under an annotated film, and write it as a session with truth.

    The vehicles' ground tracks follow from the labels and a plausible camera; a few of the vehicles report where they
    are, with errors, and the others are strangers.
    """
    # simulator, encoder and motion estimator are loaded only where they are needed: that takes time
    from gcs.annotated_film import FilmOptions, session_from_film

    options = FilmOptions(
        layout=layout,
        first_frame=first_frame,
        fps=fps,
        duration_s=duration,
        height_m=height,
        fov_deg=fov,
        pitch_deg=pitch,
        static=static,
        team=team,
        vehicles=tuple(vehicle or ()),
        errors=errors,
        boxes_from_labels=boxes == "labels",
        seed=seed,
    )
    with progress("film") as report:
        made = session_from_film(tracks, video, out, options, report)
    if as_json:
        print_json({**dict(made.lines), "folder": str(out)})
        return
    print_table(("what", "how"), ((name.replace("_", " "), text) for name, text in made.lines), head=False)
    made_in, names, table = map(as_typed, (f"{out}", f"{out}-names", f"{out}-names/identity.csv"))
    print_note(f"wrote {out}; next: gcs identify {made_in} -o {names}, then gcs score {made_in} {table}")
