"""``gcs tlog``: look into telemetry logs, check, repair and cut them.

``check`` ends with 0 when a log is whole and with 5 when anything in it is damaged.
"""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import FAR_S, AsJson, check_range, print_json, print_lines
from gcs.cli.output.tables import print_table
from gcs.cli.output.tlog_report import check_json, check_lines, repair_lines
from mavlink.errors import TlogError
from mavlink.tlog.check import check as examine
from mavlink.tlog.log import Tlog
from mavlink.tlog.summary import TlogInfo
from mavlink.tlog.summary import info as summarise

app = typer.Typer(
    help="Look into telemetry logs, check, repair and cut them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
# Damaged places listed one by one; a badly damaged log has thousands.
MOST_DAMAGE = 20
_OF_A_LOG = check_range(-FAR_S, FAR_S)
DAMAGED = 5
"""Exit code of a log that is not whole."""


@app.command("info")
def info(log: Annotated[Path, typer.Argument(help="Telemetry log.")], as_json: AsJson = False) -> None:
    """Show which systems send what, how often; and what is damaged."""
    found = summarise(Tlog.open(log))
    if as_json:
        print_json({"path": str(log), **asdict(found), "span_s": found.span_s})
    else:
        _print_info(log, found)


def _print_info(path: Path, found: TlogInfo) -> None:
    print_lines(*_head_lines(path, found), "")
    rows = (
        (str(m.system_id), str(m.component_id), m.name, str(m.count), f"{m.rate_hz:.2f}" if m.rate_hz else "-")
        for m in found.messages
    )
    print_table(("system", "component", "message", "count", "Hz"), rows, right=("system", "component", "count", "Hz"))
    print_lines("", *_damage_lines(found))


def _head_lines(path: Path, found: TlogInfo) -> list[str]:
    counts = found.counts
    lines = [f"{path}: {counts.records} messages, {counts.size_bytes} bytes"]
    if found.time_source == "none":
        lines.append("no time stamps in it: only the order is known")
    else:
        first = datetime.fromtimestamp(found.first_us * 1e-6, UTC).isoformat(" ", "milliseconds")
        lines.append(f"from {first} for {found.span_s:.1f} s")
    if found.time_source not in ("none", "big-endian"):
        lines.append(f"time stamps are {found.time_source}")
    return lines


def _damage_lines(found: TlogInfo) -> list[str]:
    counts = found.counts
    lines = [
        f"unknown messages {counts.unknown}, bad times {counts.bad_times}, times that go back {counts.backward_steps}, "
        f"damaged bytes {counts.damaged_bytes} in {len(found.damage)} places"
    ]
    lines += [f"  bytes {d.start}..{d.stop}: {d.reason}" for d in found.damage[:MOST_DAMAGE]]
    if len(found.damage) > MOST_DAMAGE:
        lines.append(f"  and {len(found.damage) - MOST_DAMAGE} more")
    return lines


@app.command("check")
def check(
    logs: Annotated[list[Path], typer.Argument(help="Telemetry logs, such as the segments of one flight.")],
    as_json: AsJson = False,
    most: Annotated[int, typer.Option("--most", min=0, max=10**9, help="Damaged places listed.")] = MOST_DAMAGE,
) -> None:
    """Check that logs are whole, and describe them. Exit code 0: all whole; 5: any damaged."""
    whole = True
    for log in logs:
        found = examine(Tlog.open(log, any_file=True))
        if as_json:
            print_json(check_json(log, found))
        else:
            print_lines(*check_lines(log, found, most))
        whole &= found.whole
    if not whole:
        raise typer.Exit(DAMAGED)


@app.command("repair")
def repair(
    log: Annotated[Path, typer.Argument(help="Telemetry log; it stays as it is.")],
    out: Annotated[Path, typer.Argument(help="New log; must not exist.")],
) -> None:
    """Copy all whole records into a new log, times recovered."""
    opened = Tlog.open(log)
    found = examine(opened)
    if opened.cut(out) != len(opened.index):
        raise TlogError(f"{out}: not all records were written")
    print_lines(*repair_lines(out, found))


@app.command("cut")
def cut(
    log: Annotated[Path, typer.Argument(help="Telemetry log.")],
    out: Annotated[Path, typer.Argument(help="New log; must not exist.")],
    start: Annotated[
        float | None, typer.Option("--from", callback=_OF_A_LOG, help="Seconds from the log's first message.")
    ] = None,
    stop: Annotated[
        float | None, typer.Option("--to", callback=_OF_A_LOG, help="Seconds from the log's first message.")
    ] = None,
    message: Annotated[
        list[int] | None, typer.Option(min=0, max=2**24 - 1, help="Keep this message id; may be repeated.")
    ] = None,
    system: Annotated[
        list[int] | None, typer.Option(min=0, max=255, help="Keep this system id; may be repeated.")
    ] = None,
) -> None:
    """Copy a part of a log; undamaged records only."""
    opened = Tlog.open(log)
    first = int(opened.index.t_us.min())
    limits = [None if s is None else first + round(s * 1e6) for s in (start, stop)]
    count = opened.cut(out, limits[0], limits[1], message or None, system or None)
    print_lines(f"{count} of {len(opened.index)} messages written to {out}")
