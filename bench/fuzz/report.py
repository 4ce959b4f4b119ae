"""Words and tables of the results; each part replaces its own section of the file."""

from __future__ import annotations

import random
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from bench.fuzz.datagrams import DatagramScore
from bench.fuzz.frames import frame_pool
from bench.fuzz.logs import LogScore
from bench.fuzz.missions import MissionScore
from bench.fuzz.readers import ReaderScore
from bench.fuzz.streams import INPUTS, lost, read_with_ours, read_with_pymavlink

_HEAD = """# What damage and hostility cost

Made by `python -m bench.fuzz`. Every case comes from a seed; the truth is known because the damage was done here.
"""
_MOST_FAILURES = 20


def write_section(path: Path, title: str, text: str) -> None:
    """Put a section into the file, in place of the one with the same title."""
    old = path.read_text(encoding="utf-8") if path.exists() else _HEAD
    body = f"## {title}\n\n{text.strip()}\n"
    pattern = re.compile(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    found = pattern.search(old)
    new = pattern.sub(lambda _: body + "\n", old) if found else f"{old.rstrip()}\n\n{body}"
    path.write_text(new.rstrip() + "\n", encoding="utf-8")


def logs_text(scores: Mapping[str, LogScore]) -> str:
    """Sums by kind of damage."""
    total = scores["all"]
    share = total.phantoms / max(1, total.whole)
    exceptions = sum("Error" in line for line in total.failures)
    lines = [
        f"{total.logs:,} logs with 0 to 4 kinds of damage each, {total.whole:,} records left whole. Exceptions "
        f"{exceptions}; whole records lost {total.lost}, with a wrong time {total.wrong_times} (and {total.lonely} "
        f"alone with their clock, which look like a damaged stamp); messages that were never written "
        f"{total.phantoms} ({share:.1e} of the whole ones; nearly all were carried by a tunnel whose own header is "
        f"gone), of unknown kinds {total.unknown_phantoms}. "
        f"Undamaged bytes named as damaged {total.false_bytes}, damaged bytes in no range "
        f"{total.missed_bytes} of {total.damaged_bytes:,}. Frames saved besides, whose own stamp is gone: "
        f"{total.found_besides:,}; stamps wrong by more than a minute that were accepted: {total.stamps_believed}. "
        f"Slowest log {total.slowest_ms:.0f} ms of CPU.",
        "",
        "| | logs | whole | lost | wrong time | phantoms | of unknown kind | falsely named B | missed B | slowest ms |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {kind} | {s.logs} | {s.whole} | {s.lost} | {s.wrong_times} | {s.phantoms} | {s.unknown_phantoms} | "
        f"{s.false_bytes} | {s.missed_bytes} | {s.slowest_ms:.1f} |"
        for kind, s in sorted(scores.items())
    ]
    shown = sorted(total.failures, key=lambda line: "lost 0, wrong times 0" in line)[:_MOST_FAILURES]
    if shown:
        lines += ["", "Seeds to look at:", "", *(f"- {line}" for line in shown)]
    return "\n".join(lines)


def datagrams_text(score: DatagramScore) -> str:
    """One paragraph."""
    lines = [
        f"{score.datagrams:,} datagrams through split, decode and the fleet's state: {score.frames:,} frames let "
        f"through, {score.notices:,} notices. Exceptions {len(score.failures)}; slowest datagram "
        f"{score.slowest_ms:.1f} ms of CPU.",
    ]
    return "\n".join([*lines, *(f"- {line[:400]}" for line in score.failures[:_MOST_FAILURES])])


def streams_text(count: int = 2000) -> str:
    """Undamaged frames lost by our parser and by pymavlink's."""
    version2 = [f for f in frame_pool(carried=False) if f[0] == 0xFD and not f[2] and f[7:10] != b"\x61\xea\0"]
    frames: Sequence[bytes] = version2[:count]
    lines = [
        f"Undamaged frames lost of {len(frames)}, one in ten hit, pieces of 333 bytes.",
        "",
        "| input | ours lost | pymavlink lost |",
        "|---|---|---|",
    ]
    for name, make in INPUTS.items():
        parts = make(frames, random.Random(1))
        lines.append(f"| {name} | {lost(parts, read_with_ours)[0]} | {lost(parts, read_with_pymavlink)[0]} |")
    return "\n".join(lines)


def missions_text(score: MissionScore) -> str:
    """One paragraph, and what failed."""
    lines = [
        f"{score.files:,} mission files: {score.accepted:,} accepted, {score.refused:,} refused in one line each. "
        f"Other exceptions {len(score.failures)}.",
    ]
    return "\n".join([*lines, *(f"- {line[:400]}" for line in score.failures[:_MOST_FAILURES])])


def readers_text(score: ReaderScore) -> str:
    """One paragraph, and what failed."""
    files = score.read + score.refused + len(score.failures)
    lines = [
        f"{files:,} files of all readers, damaged or replaced by pipes, folders, devices and links: {score.read:,} "
        f"read, {score.refused:,} refused in one line each. Exceptions, crashes, files that took longer than a minute "
        f"or more memory than three times their size and 200 MB: {len(score.failures)}. Most memory for one file: "
        f"{score.most_bytes / 1e6:.0f} MB.",
    ]
    return "\n".join([*lines, *(f"- {line[:400]}" for line in score.failures[:_MOST_FAILURES])])
