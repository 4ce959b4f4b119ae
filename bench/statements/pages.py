"""Pages about a flight that is over: roll call, report, batch page; each count, silence and remark."""

from __future__ import annotations

import contextlib
import html
import io
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from bench.flights import TrueFlight
from bench.statements.boxes import Claim
from bench.statements.sentences import Said, check_sentence

Row = Mapping[str, Any]
Tables = Mapping[str, Sequence[Row]]
Found = Iterator[tuple[Said, str]]
S = 1_000_000
IN_VIEW_FRAMES, IN_VIEW_SHARE = 4, 0.1
"""Frames, and their share, by which being in view by report and by truth may differ: the position's error."""
UNUSED = ("frozen", "zero", "jump", "drift", "spoof", "copy")
POSITION_S, KNOWN_M = 1.0, 100.0
"""Seconds by which a silence may differ that is looked at frame by frame, and a 1σ, m, above any report's."""
STOOD = "stood still"
SILENCES = re.compile(
    rf"(?:(?:; )?(?:(?:no position|its position {STOOD}) for [\d.]+ s|not known whether in view in \d+ frames))+$"
)
REMARKS = {
    "": "named",
    "never where the camera looked": "outside",
    "in view, never named": "inside",
    "all refused": "refused",
    "never heard": "unheard",
}
"""Words of a roll call's last column about a vehicle, before its reason and its silence."""


def _tables(page: str) -> Tables:
    """The rows of each table of a page by its label."""
    found = {}
    for label, inner in re.findall(r'aria-label="([^"]*)"><table>(.*?)</table>', page, re.DOTALL):
        lines = [
            re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", inner, re.DOTALL)
        ]
        heads, *rows = [[html.unescape(cell) for cell in line] for line in lines]
        found[html.unescape(label)] = [dict(zip(heads, row, strict=True)) for row in rows]
    return found


def check_rollcall(
    flown: TrueFlight, told: Mapping[str, int], rows: Sequence[Row], where: str, claims: Sequence[Claim]
) -> Found:
    """Sums and a line for each vehicle.

    Args:
        flown: the truth.
        told: ``frames``, ``boxes``, ``unnamed``.
        rows: ``id``, ``boxes``, ``remark``, and ``in view`` and ``unknown`` (frames) where that is told.
        where: whose they are.
        claims: of the flight's own identity log.
    """
    named = Counter(claim.system_id for claim in claims)
    true = {"frames": len(flown.frames), "boxes": len(claims), "unnamed": named[0]}
    for what, count in told.items():
        if count != true[what]:
            yield overall(flown, where, f"{count} {what}"), f"{true[what]} {what}"
    faulty = {flown.scenario.ugv_ids[fault.vehicle] for fault in flown.script.faults} | flown.refused.keys()
    for row in rows:
        i, boxes = int(row["id"]), int(row["boxes"] or 0)
        name, seen = flown.name(i), sum(frame.outside_px(i) < 0 for frame in flown.frames.values())
        if boxes != named[i]:
            yield overall(flown, where, f"{name}: {boxes} boxes", i), f"{named[i]} boxes have its name"
        off = abs(row.get("in view", seen) - seen) - row.get("unknown", 0)
        if i not in faulty and off > IN_VIEW_FRAMES + IN_VIEW_SHARE * seen:
            yield overall(flown, where, f"{name}: in view in {row['in view']} frames", i), f"it was in {seen}"
        if i not in faulty and row.get("unknown", 0) > _blind_frames(flown, i) + IN_VIEW_FRAMES:
            yield (
                overall(flown, where, f"{name}: not known in {row['unknown']} frames", i),
                "it and the UAV reported",
            )
        for why in _remark(flown, i, row["remark"], boxes, seen):
            yield overall(flown, where, f"{name}: {row['remark']}", i), why


def _blind_frames(flown: TrueFlight, system_id: int) -> int:
    """Frames in which the UAV or the vehicle had not reported for long."""
    silences = (max(flown.silent_s(i, t_us, "position") for i in (flown.uav_id, system_id)) for t_us in flown.frames)
    return sum(silent_s > POSITION_S / 2 for silent_s in silences)


def _remark(flown: TrueFlight, system_id: int, remark: str, boxes: int, seen: int) -> Iterator[str]:
    heard = math.isfinite(flown.silent_s(system_id, flown.moments[-1].now_us))
    outcome = re.sub(SILENCES, "", remark).partition(":")[0]
    if STOOD in remark and not _has_fault(flown, system_id, "frozen"):
        yield "no report of it was frozen"
    told, refused = REMARKS.get(outcome), flown.refused.get(system_id, 0)
    if told is None:
        yield "a remark that is not known"
    elif (told == "named") != bool(boxes):
        yield f"{boxes} boxes have its name"
    elif (told == "refused") != (refused > 0 and not heard):
        yield f"{refused} of its packets were refused"
    elif told != "named" and (told == "unheard") != (not heard and not refused):  # one may be named by statement
        yield "it was heard" if heard else "it was never heard"
    elif told == "outside" and seen:
        yield f"it was in view in {seen} frames"


def overall(flown: TrueFlight, where: str, text: str, system_id: int = 0) -> Said:
    """Something that is said of a whole flight."""
    return Said(where=where, t_us=flown.moments[-1].now_us, text=text, system_id=system_id)


def check_report(flown: TrueFlight, page: str, claims: Sequence[Claim]) -> Found:
    """The page of ``gcs report``: roll call, alarms, warnings, marks, and what is known of each vehicle."""
    tables, lead = _tables(page), re.search(r"(\d+) of (\d+) boxes in (\d+) frames have a name", page)
    if lead is None:
        yield overall(flown, "report", page.partition("<p>")[2][:200]), "a lead that is not known"
        return
    named, boxes, frames = map(int, lead.groups())
    told = {"frames": frames, "boxes": boxes, "unnamed": boxes - named}
    yield from check_rollcall(flown, told, tables["Roll call"], "report", claims)
    labels = ("Alarms", "Warnings and what the operator did")
    written = {row["what"] for label in labels for row in tables.get(label, ())}
    for event in flown.moments[-1].events:
        whole = f"{flown.name(event.system_id)}: {event.text}"
        if (event.level != "info" or event.kind in ("mark", "operator")) and not written & {event.text, whole}:
            said = Said(where="report", t_us=event.t_us, text=event.text)
            yield said, "the flight's log has it, and the report does not"
    began_us = min(t_us for times in (*flown.heartbeats.values(), *flown.positions.values()) for t_us in times)
    for row in tables.get("Alarms", ()):
        t_us = began_us + round((_seconds(row["from"]) + 1.0) * S)
        said = Said(where="report", t_us=t_us, text=row["what"], standing=True)
        yield from ((said, why) for why in check_sentence(flown, said))
    for i in flown.scenario.ugv_ids:
        facts = {row["what"]: row["found"] for row in tables.get(f"What is known of {flown.name(i)}", ())}
        for what, why in _facts(flown, i, facts):
            yield overall(flown, "report", f"{flown.name(i)}: {what}: {facts.get(what)}", i), why


def _has_fault(flown: TrueFlight, system_id: int, *kinds: str) -> bool:
    faults = (fault for fault in flown.script.faults if fault.kind in kinds)
    return any(flown.scenario.ugv_ids[fault.vehicle] == system_id for fault in faults)


def _facts(flown: TrueFlight, system_id: int, facts: Row) -> Iterator[tuple[str, str]]:
    stop_us = flown.moments[-1].now_us
    times = [t_us for t_us in flown.positions.get(system_id, ()) if t_us <= stop_us]
    heard = (*flown.heartbeats.values(), *flown.positions.values())
    start_us = min(flown.moments[0].now_us, *(times_us[0] for times_us in heard if times_us))
    true_s = max(after - before for before, after in pairwise([start_us, *times, stop_us])) / S
    told = facts.get(silence := "longest without a position", "")
    match = re.fullmatch(rf"([\d.]+) s(?:, while it {STOOD})?", told)
    if STOOD in told and not _has_fault(flown, system_id, "frozen"):
        yield silence, "no report of it was frozen"
    # a position that is refused is none, whenever it came
    faulty = _has_fault(flown, system_id, *UNUSED)
    if match is None or (not faulty and abs(float(match[1]) - true_s) > POSITION_S):
        yield silence, f"it was {true_s:.1f} s"
    most = re.search(r"most ([\d.]+) m", facts.get(spread := "1σ of its position", ""))
    if most and float(most[1]) > KNOWN_M:
        yield spread, "that long after the last report nobody knows a position"


def _seconds(told: str) -> float:
    seconds: float = sum(float(part) * 60**k for k, part in enumerate(reversed(told.lstrip("-").split(":"))))
    return -seconds if told.startswith("-") else seconds


def check_batch(flown: TrueFlight, page: str, claims: Sequence[Claim]) -> Found:
    """The page over all flights of a batch of one."""
    tables = _tables(page)
    sums = {row["sum"]: row["all flights"] for row in tables["Sums over all flights"]}
    told = {"frames": int(sums["frames looked at"]), "boxes": int(sums["boxes"])}
    reason = tables["Flights that were named, the worst first"][0]["reason"]
    rows = [
        {"id": row["system id"], "boxes": row["boxes"], "remark": _reason(reason, row["vehicle"], row["boxes"])}
        for row in tables["Vehicles over all flights, the worst first"]
    ]
    yield from check_rollcall(flown, told, rows, "batch page", claims)


def _reason(reason: str, name: str, boxes: str) -> str:
    """Reason in the flight's line why a vehicle was not named."""
    about = [words for words in reason.split("; ") if boxes == "0" and re.search(rf"\b{name}\b", words)]
    outcomes = (words.partition(":")[0].partition(" (")[0] for words in about)
    return next((outcome for outcome in outcomes if outcome in REMARKS), "")


def printed_remarks(show: Callable[[], None]) -> list[str]:
    """The last column of the roll call as it is printed, a remark a vehicle."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        show()
    head, *lines = out.getvalue().splitlines()
    return [line[head.index("remark") :].strip() for line in lines[:-2]]
