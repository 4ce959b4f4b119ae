"""``gcs calibrate``: a lens file from a video of a chessboard."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import AsJson, print_json, print_lines, print_note
from gcs.cli.output.progress import progress
from gcs.cli.output.tables import print_table
from vision.camera.calibrate import MAX_VIEWS, PARAMETERS, Calibration, doubts
from vision.camera.calibrate import calibrate as fit
from vision.camera.calibrate_views import Board, chosen, find_views
from vision.camera.lens_file import lens_text
from vision.errors import CameraError
from vision.video.video import VideoFile


def calibrate(
    video: Annotated[Path, typer.Argument(help="Video of a chessboard that moves all over the image.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Lens file to write, for [camera] lens in the mission.")],
    board: Annotated[str, typer.Option(help="Inner corners of the board, where four squares meet.")] = "9x6",
    square: Annotated[float, typer.Option(help="Side of a square, metres.")] = 0.025,
    as_json: AsJson = False,
) -> None:
    """Find a camera's focal length, centre and lens distortion; writes nothing that is not good enough."""
    if out.exists():
        raise CameraError(f"{out}: exists already and is not overwritten; name another with -o")
    if not out.absolute().parent.is_dir():
        raise CameraError(f"{out}: the folder does not exist; create it")
    pattern = _board(board, square)
    with VideoFile.open(video) as film, progress("calibrate") as report:
        found, looked = find_views(film, pattern, report)
        size = film.width, film.height
    views = chosen(found, MAX_VIEWS)
    print_note(f"the board is whole and sharp in {len(found)} of {looked} frames, {len(views)} of them differ")
    calibration = fit(views, pattern, size)
    against = list(doubts(calibration))
    if as_json:
        size_px = {"width": size[0], "height": size[1]}
        print_json({**size_px, **_values(calibration), **_facts(calibration, video, pattern), "doubts": against})
    else:
        _print_figures(calibration)
    if against:
        raise CameraError(f"{out} is not written: {'; '.join(against)}")
    _write(out, lens_text(calibration.intrinsics, _facts(calibration, video, pattern)))
    print_note(f'wrote {out}; use it with [camera] lens = "{out.name}" in a mission file beside it')


def _values(calibration: Calibration) -> dict[str, float]:
    camera = calibration.intrinsics
    values = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion.tolist())
    return dict(zip(PARAMETERS, values, strict=True))


def _print_figures(calibration: Calibration) -> None:
    camera = calibration.intrinsics
    rows = [
        (name, f"{value:.{digits}f}", f"± {std:.{digits}f}{unit}")
        for (name, value), std, digits, unit in zip(
            _values(calibration).items(),
            calibration.std,
            (2,) * 4 + (5,) * 5,
            (" px",) * 4 + ("",) * 5,
            strict=True,
        )
    ]
    print_lines(
        f"{len(calibration.views)} views of {camera.width}×{camera.height}, error {calibration.rms_px:.3f} px RMS"
    )
    print_lines(f"board seen in {calibration.coverage:.0%} of the image, ±{calibration.pixel_px:.2f} px in its corners")
    print_table(("parameter", "value", "1σ"), rows, right=("value",), head=False)


def _board(text: str, square_m: float) -> Board:
    match = re.fullmatch(r"(\d{1,3})[x×](\d{1,3})", text.strip().lower())
    if match is None:
        raise CameraError(f"--board {text!r}: write it as 9x6, the inner corners along both sides")
    return Board(columns=int(match[1]), rows=int(match[2]), square_m=square_m)


def _facts(calibration: Calibration, video: Path, board: Board) -> dict[str, object]:
    """Description of the calibration, for the file."""
    std = {name: float(value) for name, value in zip(PARAMETERS, calibration.std, strict=True)}
    return {
        "video": video.name,
        "board": f"{board.columns}x{board.rows}",
        "square_m": board.square_m,
        "views": len(calibration.views),
        "rms_px": calibration.rms_px,
        "pixel_px": calibration.pixel_px,
        "coverage": calibration.coverage,
        "std": std,
    }


def _write(out: Path, text: str) -> None:
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise CameraError(f"{out}: cannot be written: {error.strerror}; name another with -o") from error
