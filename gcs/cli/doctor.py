"""``gcs doctor``: what this machine has for a flight."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import AsJson, print_json
from gcs.cli.output.tables import print_table
from gcs.health.machine import Check, checks

__all__ = ["doctor"]

NOT_READY = 2
_SMALLEST = (80, 24)
_MARKS = {"ok": "ok", "short": "short", "bad": "BAD"}


def doctor(
    sessions: Annotated[Path, typer.Option(help="Where flights are recorded.")] = Path("sessions"),
    as_json: AsJson = False,
) -> None:
    """Show what this machine has: versions, detector speed, video, ports, disk, clock, terminal; and what to do."""
    found = [*checks(sessions), _terminal()]
    if as_json:
        print_json({"checks": [asdict(check) for check in found]})
    else:
        print_table(("verdict", "check", "found"), (row for check in found for row in _rows(check)), head=False)
    if any(check.verdict == "bad" for check in found):
        raise SystemExit(NOT_READY)


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
