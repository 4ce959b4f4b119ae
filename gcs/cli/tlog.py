"""``gcs tlog``: look into telemetry logs, check, repair and cut them.

``check`` ends with 0 when a log is whole and with 5 when anything in it is damaged.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from gcs.cli.output.console import FAR_S, AsJson, check_range, print_json, print_lines
from gcs.cli.output.tables import print_table
from mavlink.errors import TlogError
from mavlink.tlog.check import TlogCheck
from mavlink.tlog.check import check as examine
from mavlink.tlog.log import Tlog
from mavlink.tlog.summary import TlogInfo
from mavlink.tlog.summary import info as summarise

_MAX_STEPS = 5
_SPEED = (0.8, 1.25)
"""Speed of a clock outside which its stamps are not the time of a flight."""
MAX_DAMAGE = 20
"""Maximum number of damaged places that are listed; a badly damaged log has thousands."""
_CHECK_SECONDS = check_range(-FAR_S, FAR_S)
DAMAGED = 5
"""Exit code of a log that is not whole."""


def check_lines(path: Path, found: TlogCheck, most: int) -> list[str]:
    """The report; at most this many damaged places one by one."""
    verdict = "whole" if found.whole else "damaged"
    lines = [f"{path}: {verdict}, {found.records} whole messages in {found.size_bytes} bytes"]
    lines.append(
        f"MAVLink 1 {found.version_1}, MAVLink 2 {found.version_2} of which signed {found.signed} "
        f"(signatures are not checked here), of unknown messages {found.unknown}"
    )
    lines += [
        *_kind_lines(found),
        *_time_lines(found),
        *_writer_lines(found),
        *_clock_lines(found),
        *_ranges(found, most),
    ]
    return lines


def _kind_lines(found: TlogCheck) -> list[str]:
    if found.sent_as_text:
        return [
            "each line feed follows a carriage return: something took the log for text and put those in; copy it "
            "again from where it was recorded, as binary"
        ]
    return [f"it begins like {found.looks_like}"] if found.looks_like else []


def _time_lines(found: TlogCheck) -> list[str]:
    if found.cut_short:
        return [
            f"{found.cut_short} MAVLink 1 frames with {found.time_source} time stamps, each without its last eight "
            "bytes: the program that wrote this log cut them, so none can be checked and none is whole"
        ]
    if found.time_source == "none":
        return ["no time stamps: only the order is known"] if found.records else ["no MAVLink frame: is it a log?"]
    if found.bad_times == found.records:
        return ["not one time stamp can be right: only the order is known"]
    lines = [f"time stamps {found.time_source}; records without a usable time of their own {found.bad_times}"]
    if found.backward_steps:
        lines.append(f"time goes back {found.backward_steps} times, {found.far_backward_steps} by more than a second")
    if found.speed < _SPEED[0] or found.speed > _SPEED[1]:
        lines.append(
            f"time is compressed: the senders' clocks run {found.speed:.1f} times as fast as the stamps, which are "
            "therefore not the time of the flight"
        )
    return lines


def _writer_lines(found: TlogCheck) -> list[str]:
    if not found.several_writers:
        return []
    return [
        f"several programs wrote this file at once: {found.torn_by_others} messages are cut in two by others', at "
        f"{found.times_crossed} damaged places time goes back"
    ]


def _clock_lines(found: TlogCheck) -> list[str]:
    lines = [
        f"system {clock.system_id} component {clock.component_id} was started {clock.boots} times"
        for clock in found.clocks
        if clock.boots > 1
    ]
    shown = max(found.clocks, key=lambda clock: len(clock.steps), default=None)
    steps = shown.steps if shown else ()
    lines += [f"the recording clock was set by {s.by_s:+.1f} s at byte {s.offset}" for s in steps[:_MAX_STEPS]]
    if len(steps) > _MAX_STEPS:
        lines.append(f"and {len(steps) - _MAX_STEPS} times more")
    return lines


def _ranges(found: TlogCheck, most: int) -> list[str]:
    if not found.damage:
        return []
    lines = [f"damaged: {found.damaged_bytes} bytes in {len(found.damage)} places"]
    reasons = Counter(damage.reason for damage in found.damage)
    lines += [f"  {count:>6} {reason}" for reason, count in reasons.most_common()]
    lines += [f"  bytes {d.start}..{d.stop} ({d.stop - d.start}): {d.reason}" for d in found.damage[:most]]
    if len(found.damage) > most:
        lines.append(f"  and {len(found.damage) - most} more")
    return lines


def check_json(path: Path, found: TlogCheck) -> dict[str, Any]:
    """All that was found, with all damage listed."""
    verdict = {"path": str(path), "whole": found.whole, "several_writers": found.several_writers}
    clocks = [asdict(clock) | {"speed": clock.speed} for clock in found.clocks]
    return verdict | asdict(found) | {"speed": found.speed, "clocks": clocks}


def repair_lines(out: Path, found: TlogCheck) -> list[str]:
    """Lines on what was written and left out."""
    lines = [f"{found.records} messages written to {out}"]
    stamps = sum(d.reason == "impossible time" for d in found.damage)
    places = len(found.damage) - stamps
    if places:
        bytes_out = found.damaged_bytes - 8 * stamps
        lines.append(f"left out: {bytes_out} bytes in {places} places that hold no whole message")
    if found.time_source != "none" and found.bad_times == found.records:
        lines.append("no time could be right: messages are a millisecond apart from 1970 on, only their order is real")
    elif found.bad_times:
        lines.append(f"{found.bad_times} messages had no usable time and got that of the message before")
    if found.time_source == "none":
        lines.append("there were no times: messages are a millisecond apart from 1970 on, only their order is real")
    if found.time_source == "little-endian":
        lines.append("times were little-endian and are now big-endian, as every program expects")
    return lines


app = typer.Typer(
    help="Look into telemetry logs, check, repair and cut them.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)


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
    lines += [f"  bytes {d.start}..{d.stop}: {d.reason}" for d in found.damage[:MAX_DAMAGE]]
    if len(found.damage) > MAX_DAMAGE:
        lines.append(f"  and {len(found.damage) - MAX_DAMAGE} more")
    return lines


@app.command("check")
def check(
    logs: Annotated[list[Path], typer.Argument(help="Telemetry logs, such as the segments of one flight.")],
    as_json: AsJson = False,
    most: Annotated[int, typer.Option("--most", min=0, max=10**9, help="Damaged places listed.")] = MAX_DAMAGE,
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
        float | None, typer.Option("--from", callback=_CHECK_SECONDS, help="Seconds from the log's first message.")
    ] = None,
    stop: Annotated[
        float | None, typer.Option("--to", callback=_CHECK_SECONDS, help="Seconds from the log's first message.")
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
