"""Words of ``gcs tlog check`` and ``gcs tlog repair``."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mavlink.tlog.check import TlogCheck

_MOST_STEPS = 5
_SPEED = (0.8, 1.25)  # outside, the stamps are not the time of a flight


def check_lines(path: Path, found: TlogCheck, most: int) -> list[str]:
    """The report; at most so many damaged places one by one."""
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
        *_damage_lines(found, most),
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
    lines += [f"the recording clock was set by {s.by_s:+.1f} s at byte {s.offset}" for s in steps[:_MOST_STEPS]]
    if len(steps) > _MOST_STEPS:
        lines.append(f"and {len(steps) - _MOST_STEPS} times more")
    return lines


def _damage_lines(found: TlogCheck, most: int) -> list[str]:
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
    """All of it, all damage listed."""
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
