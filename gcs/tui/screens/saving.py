"""Files that an operator asks for, new ones only: the screen as SVG, a still of the full frame as PNG.

Screens in a browser write nothing on this computer: there they are downloads.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import os
from pathlib import Path
from typing import Any

import cv2
from textual.app import App

from gcs.report.overlay import draw
from gcs.snapshot import Event, Snapshot
from gcs.station import Station
from gcs.tui.draw.format import clock
from gcs.tui.screens.prompts import Prompt
from infra.files.safe_open import create, open_folder
from infra.plain_text import plain
from infra.wall_clock import now_us

SCREENSHOT_TITLE = "Rollcall"
STILLS = "stills"
"""Folder in that of the flight."""
MOST_ALIKE = 1000
"""Stills of one moment."""
NO_FRAME = "there is no frame to save yet"


def ask_to_save_screen(app: App[Any], snapshot: Snapshot | None) -> None:
    """Prompt where to, then save the screen as it was before the question."""
    drawing = app.export_screenshot(title=SCREENSHOT_TITLE)
    moment = _moment(snapshot) if snapshot is not None else "screen"
    name = f"rollcall-{moment}.svg"
    if app.is_web:
        _download(app, name, drawing.encode())
        return
    ask = Prompt(
        "Save the screen as SVG",
        "a new file; nothing is overwritten",
        lambda text: save_new(text, drawing.encode()),
        value=name,
    )
    app.push_screen(ask, lambda path: None if path is None else app.notify(f"saved {path}", markup=False))


async def save_still(app: App[Any], station: Station, snapshot: Snapshot | None, pick: tuple[int, int]) -> None:
    """Save the frame at its own size with boxes and names: of a flight into its folder, else where the operator says.

    Args:
        app: to show questions and results.
        station: whose frame it is; its event log reports the file.
        snapshot: what is on the screen now.
        pick: system id of the picked vehicle, and track id of a box without a name; 0 none.
    """
    if snapshot is None or snapshot.image is None:
        app.notify(NO_FRAME, severity="warning", markup=False)
        return
    name = f"rollcall-{_moment(snapshot)}-frame-{snapshot.frame}.png"
    # a large frame takes a tenth of a second, in which keys are to be answered
    picture = await asyncio.to_thread(_png, snapshot, *pick)
    if app.is_web:
        _download(app, name, picture)
        return

    def report(path: Path | None) -> None:
        if path is None:
            return
        if station.folder is not None:
            path = path.relative_to(station.folder)  # the folder may be moved, with its event log
        text = f"still of frame {snapshot.frame} saved: {path}"
        station.add_event(Event(t_us=_now_us(station), level="info", kind="operator", text=text, system_id=pick[0]))
        app.notify(f"saved {path}", markup=False)

    if station.folder is None:
        hint = "a new file; nothing is overwritten"
        app.push_screen(Prompt("Save the frame as PNG", hint, lambda text: save_new(text, picture), value=name), report)
        return
    try:
        report(await asyncio.to_thread(_save_beside, station.folder, name, picture))
    except OSError as error:
        app.notify(plain(f"not saved: {error.strerror}"), severity="error", markup=False)


def _download(app: App[Any], name: str, data: bytes) -> None:
    app.deliver_binary(io.BytesIO(data), save_filename=name)
    app.notify(f"{name} goes to your browser, which may have to be told to allow pop-up windows", markup=False)


def _now_us(station: Station) -> int:
    return now_us() if station.timeline is None else station.timeline.now_us


def _moment(snapshot: Snapshot) -> str:
    return clock(snapshot.t_us).replace(":", "")


def _png(snapshot: Snapshot, selected: int, track: int) -> bytes:
    return cv2.imencode(".png", draw(snapshot, selected=selected, track=track))[1].tobytes()


def save_new(path: str, data: bytes) -> Path:
    """Write a file that must not exist; raises OSError or ValueError in words an operator can act on."""
    goal = Path(path.strip()).expanduser()
    if not path.strip():
        raise ValueError("a file name is needed")
    try:
        _write(create(goal), data)
    except FileExistsError:
        raise ValueError("that file exists; choose another name") from None
    return goal


def _save_beside(folder: Path, name: str, data: bytes) -> Path:
    """Write a still under a name that is free: ``name.png``, ``name.1.png`` …; the folder of stills is made.

    Raises:
        OSError: it cannot be written, or a link is in the place of a folder.
    """
    goal = folder / STILLS / name
    flight = open_folder(folder)
    try:
        with contextlib.suppress(FileExistsError):
            os.mkdir(STILLS, dir_fd=flight)
        stills = open_folder(STILLS, folder=flight)
    finally:
        os.close(flight)
    try:
        for number in range(MOST_ALIKE):
            path = goal.with_suffix(f".{number}{goal.suffix}") if number else goal
            with contextlib.suppress(FileExistsError):
                _write(create(path.name, folder=stills), data)
                return path
    finally:
        os.close(stills)
    raise FileExistsError(errno.EEXIST, f"{goal.name} and {MOST_ALIKE} more are there")


def _write(fd: int, data: bytes) -> None:
    with os.fdopen(fd, "wb") as file:
        file.write(data)
