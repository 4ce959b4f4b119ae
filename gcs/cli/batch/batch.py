"""``gcs batch``: many recordings in, tables out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from gcs.cli.output.console import (
    FRAME_SIZE,
    SOME_FAILED,
    AsJson,
    check_range,
    parse_frame_size,
    print_json,
    print_lines,
    print_note,
)
from gcs.cli.output.progress import Report, progress

MAX_JOBS, MAX_RETRIES = 1024, 100
LONGEST_S = 30 * 86_400.0
MIN_GIB, MAX_GIB = 0.1, 65_536.0
_FINE = 1000
"""The bar counts flights in this many parts: a long one moves it too."""


def batch(
    flights: Annotated[
        list[str] | None,
        typer.Argument(
            help="Session folders, telemetry logs, folders or patterns of them, addresses as s3://bucket/*; "
            "NAME=FLIGHT gives one another name.",
        ),
    ] = None,
    *,
    out: Annotated[str, typer.Option("--out", "-o", help="Output folder or address; an unfinished batch resumes.")],
    lists: Annotated[
        list[Path] | None,
        typer.Option("--list", help="File with more flights, one per line; may be repeated."),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", "-j", callback=check_range(1, MAX_JOBS), help="Flights worked on at once; default: one per core."
        ),
    ] = None,
    retries: Annotated[
        int,
        typer.Option(
            callback=check_range(0, MAX_RETRIES), help="Further attempts after a worker died or took too long."
        ),
    ] = 1,
    timeout: Annotated[
        float | None, typer.Option(callback=check_range(1, LONGEST_S), help="Time limit of one attempt, seconds.")
    ] = None,
    memory: Annotated[
        float | None,
        typer.Option(
            callback=check_range(MIN_GIB, MAX_GIB),
            help="Memory limit of one worker, GiB; default: its share of the machine.",
        ),
    ] = None,
    scheduler: Annotated[
        str, typer.Option(help="Dask scheduler to run on, such as tcp://head:8786.", show_default=False)
    ] = "",
    mission: Annotated[Path | None, typer.Option(help="Mission file; overrides the sessions' own.")] = None,
    frame_size: Annotated[str | None, typer.Option(help=FRAME_SIZE)] = None,
    detect: Annotated[bool, typer.Option("--detect", help="Detect vehicles anew, whatever was recorded.")] = False,
    as_json: AsJson = False,
) -> None:
    """Name the boxes of many recordings, on this machine or a cluster; what is done already is skipped."""
    from gcs.batch.batch import BatchWork, run_batch
    from gcs.batch.flights import find_flights
    from gcs.batch.jobs import BatchOptions
    from gcs.batch.runner import RunLimits

    options = BatchOptions(
        detect=detect, mission=str(mission.absolute()) if mission else "", frame_size=parse_frame_size(frame_size)
    )
    most_bytes = round(memory * 2**30) if memory else None
    limits = RunLimits(retries=retries, timeout_s=timeout, most_bytes=most_bytes)
    found = find_flights(flights or (), print_note, lists=lists or ())
    shown = _Shown(len(found), as_json)
    with progress("batch", words=shown.words) as report:
        shown.report = report
        counts = run_batch(
            found,
            out,
            options=options,
            work=BatchWork(workers=jobs or 0, scheduler=scheduler, limits=limits),
            on_result=shown.result,
            on_frames=shown.frames,
            note=print_note,
        )
    seconds = round(time.monotonic() - shown.began_s, 3)
    if as_json:
        figures = {name: getattr(counts, name) for name in ("done", "skipped", "failed", "frames")}
        print_json({"flights": len(found), **figures, "seconds": seconds, "folder": out})
    else:
        print_lines(
            f"{counts.done} of {len(found)} flights done, {counts.skipped} of them before; {counts.failed} failed; "
            f"{counts.frames} frames in {seconds:.1f} s; wrote {out}"
        )
    if counts.failed:
        raise SystemExit(SOME_FAILED)


class _Shown:
    """Progress of a batch while it runs."""

    def __init__(self, flights: int, as_json: bool) -> None:
        self.began_s = time.monotonic()
        self.report: Report = lambda done, total: None
        self._flights, self._as_json = flights, as_json
        self._ended = self._failed = self._frames = 0
        self._partial: dict[str, tuple[int, int]] = {}

    def result(self, record: Any, skipped: bool) -> None:  # noqa: ANN401 - its class is loaded later
        """Show that one flight is over."""
        self._partial.pop(record.flight, None)
        self._ended += 1
        self._failed += record.status == "failed"
        self._frames += 0 if skipped else record.frames or 0
        if self._as_json:
            keys = ("flight", "status", "error", "frames", "seconds", "named", "vehicles", "attempts")
            print_json({**{key: getattr(record, key) for key in keys}, "skipped": skipped})
        elif record.error:
            print_note(f"{record.flight} failed: {record.error}")
        self._tell()

    def frames(self, flight: str, done: int, total: int) -> None:
        """Progress of one flight."""
        self._partial[flight] = done, total
        self._tell()

    def words(self) -> str:
        """Flights and frames, beside the bar."""
        looked = self._frames + sum(done for done, _ in self._partial.copy().values())
        rate = looked / max(time.monotonic() - self.began_s, 1e-3)
        failed = f", {self._failed} failed" if self._failed else ""
        return f"{self._ended} of {self._flights} flights{failed}, {rate:.0f} frames/s"

    def _tell(self) -> None:
        parts = sum(done / max(total, 1) for done, total in self._partial.copy().values())
        self.report(round(_FINE * min(self._ended + parts, self._flights)), _FINE * self._flights)
