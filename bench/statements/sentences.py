"""The sentences that this program says of a flight, with their fields, and when each is true.

A sentence that no template knows is a finding: a checker that passes over what it cannot read can be fooled.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from bench.flights import TrueFlight
from gcs.certainty import CONFIRMED
from sim.world.scenario import UAV_ID

S = 1_000_000
SLACK_S = 1.2
"""A turn of the fold, the monitor's half second, a frame that waits for its telemetry, rounding."""
SILENT_S, LOST_S = 3.4, 3.0
"""Seconds without a heartbeat, while positions stop, and without a position, by ``docs/operations.md`` less a tenth."""
HOLD_S = 5.0
"""An alarm may stand for this long after its cause, which has gone for three seconds then."""
ADRIFT_S, STOPPED_S = 3.0, 0.45
"""Time for which a lie that has ended is still in the fold, and least time without a frame that is a stop, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """A sentence, where it was said, and of what time."""

    where: str
    t_us: int
    text: str
    system_id: int = 0
    standing: bool = False
    """It is said of the present all the while; else once, of what has just come."""
    ending: bool = False
    """It is the cause of an alarm that is said to be over."""


Fields = Mapping[str, str]
Check = Callable[[TrueFlight, Said, Fields, int], str]
"""Check that gives what is false, empty: nothing; the last argument: system id of whom a sentence is about."""
FIELDS = {
    "name": r"UAV(?:-\d+)?|UGV-\d+|none of ours",
    "other": r"UAV|UGV-\d+",
    "last": r"UAV|UGV-\d+|another",
    "names": r"(?:UAV|UGV-\d+)(?:, (?:UAV|UGV-\d+))*",
    "id": r"\d+",
    "track": r"\d+",
    "count": r"\d+",
    "seconds": r"\d+(?:\.\d+)?",
    "percent": r"\d{1,2}",
    "within": r"\d+ (?:s|min)",
    "kind": r"[\w ]+",
    "link": r"[\w.:/]+",
    "mode": r"[\w ]+",
    "text": r".+",
}


def _compiled(template: str) -> re.Pattern[str]:
    """``{name}`` and the like are typed fields; the rest is as it stands."""
    parts = re.split(r"\{(\w+)\}", template)
    return re.compile("".join(f"(?P<{p}>{FIELDS[p]})" if k % 2 else re.escape(p) for k, p in enumerate(parts)))


def _id(name: str) -> int:
    return 0 if name == "none of ours" else int(name.partition("-")[2] or UAV_ID)


def _so(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    """No script contradicts it."""
    return ""


def _there(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    first_us = min(flown.heartbeats.get(who, [0]))
    return (
        "" if 0 <= said.t_us - first_us < SLACK_S * S else f"its first heartbeat came at {flown.at_s(first_us):.1f} s"
    )


def _speaks(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    # its words come beside its heartbeats, the first before them
    silent_s = flown.silent_s(who, said.t_us + S)
    return f"it has been silent for {silent_s:.1f} s" if silent_s > SILENT_S + 1.0 else ""


def _open(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    return "the fleet signs, and the station has its keys" if flown.script.injected.signed else ""


def _named(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    whose = flown.whose_track(int(fields["track"]), said.t_us)
    sure = int(fields["percent"]) >= 100 * CONFIRMED
    return f"it is {flown.name(whose or 0)}" if sure and whose not in (None, who) else ""


def _stranger(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    return _named(flown, said, fields, 0)


def _left(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    seen_us = flown.seen_later(int(fields["track"]), said.t_us)
    return f"the track goes on at {flown.at_s(seen_us):.1f} s" if said.t_us < seen_us < said.t_us + S else ""


def _without_position(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    age_s = flown.silent_s(who, said.t_us, "position")
    told_s = float(fields["seconds"]) if "seconds" in fields else max(age_s, LOST_S)
    lies = flown.fault_of(who, said.t_us, within_s=ADRIFT_S)
    return f"its last position came {age_s:.1f} s before" if abs(told_s - age_s) > SLACK_S and not lies else ""


def _never_heard(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    heard = flown.refused.get(who) or math.isfinite(flown.silent_s(who, said.t_us))
    return "it was heard" if heard else ""


def _unheard(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    told = {_id(name) for name in fields["names"].split(", ")}
    ids = [i for i in flown.scenario.ugv_ids if not flown.refused.get(i)]
    at_us = (said.t_us + round(SLACK_S * S), said.t_us - round((HOLD_S if said.standing else SLACK_S) * S))
    later, before = ({i for i in ids if math.isinf(flown.silent_s(i, t_us))} for t_us in at_us)
    return "" if later <= told <= before else f"never heard were {sorted(map(flown.name, later))}"


def _lost(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    ids = map(_id, [*fields["names"].split(", "), *[fields["last"]] * (fields["last"] != "another")])
    known = [i for i in ids if flown.silent_s(i, said.t_us, "position") < 1.0 and _lies(flown, said, fields, i)]
    return f"{', '.join(map(flown.name, known))} reports where it is" if known else ""


def _unaccounted(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    # it was so at the comparison, which may be a second old
    shown = [each.snapshot for each in flown.moments if said.t_us - S <= each.snapshot.t_us <= said.t_us]
    rows = [row for snapshot in shown for row in snapshot.vehicles if row.role == "ugv"]
    lies = any(flown.fault_of(row.system_id, said.t_us, within_s=ADRIFT_S) for row in rows)
    found = all((row.track_id and row.standing != "coasting") or row.in_view is False for row in rows)
    return "all are seen and named, or out of view" if found and not lies else ""


def _one_lies(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    """Said of a box, whose candidates may be several."""
    lies = any(flown.fault_of(i, said.t_us, within_s=ADRIFT_S) for i in flown.scenario.ugv_ids)
    return "" if lies else "all positions are right"


def _silent(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    looks = [said.t_us - k * S // 2 for k in range(2 * round(HOLD_S) + 1 if said.standing else 1)]
    silences = [flown.silent_s(who, t_us, "heartbeat") for t_us in looks if flown.silent_s(who, t_us) > 1.0]
    lately = any(SILENT_S < silent_s < math.inf for silent_s in silences)
    return "" if lately else f"it was heard {flown.silent_s(who, said.t_us):.1f} s before"


def _link_silent(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    looks = [said.t_us - k * S // 2 for k in range(2 * round(HOLD_S) + 1 if said.standing else 1)]
    senders = flown.heartbeats.keys() | flown.positions.keys()
    silences = [min(flown.silent_s(i, t_us) for i in senders) for t_us in looks]
    return "" if max(silences) > SILENT_S else f"somebody was heard {silences[0]:.1f} s before"


def _lies(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    fault = flown.fault_of(who, said.t_us, within_s=said.standing * HOLD_S + ADRIFT_S * (not said.ending))
    return "" if fault else "its positions are right"


def _forged(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    # somebody forges the first vehicle of a fleet that signs
    forged = flown.script.injected.signed and who == flown.scenario.ugv_ids[0]
    return "" if forged or flown.refused.get(who) else "all its packets are rightly signed"


def _stopped(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    came = [now_us for now_us, frame_us in flown.turns if frame_us and now_us <= said.t_us]
    since_us = said.t_us - round(HOLD_S * S) * said.standing
    longest_s = max((b - a for a, b in pairwise([*came, said.t_us]) if b >= since_us), default=0) / S
    return "" if longest_s > STOPPED_S else f"frames come, {longest_s:.1f} s apart"


def _comes_and_goes(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    came = [frame_us for now_us, frame_us in flown.turns if frame_us and now_us <= said.t_us]
    stops = sum(b - a > 2 * S for a, b in pairwise([*came, said.t_us]))
    return "" if abs(stops - int(fields["count"])) <= 1 else f"it has stopped {stops} times"


def _on_and_off(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    times = [t_us for t_us in flown.heartbeats.get(who, ()) if t_us <= said.t_us]
    silences = sum(b - a > SILENT_S * S for a, b in pairwise([*times, said.t_us]))
    return "" if abs(silences - int(fields["count"])) <= 1 else f"it has been silent {silences} times"


def _stale_often(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    looks = range(flown.scenario.start_us, said.t_us, S // 5)
    stale = [flown.silent_s(who, t_us, "position") > 1.0 for t_us in looks]
    times = sum(b and not a for a, b in pairwise(stale))
    return "" if abs(times - int(fields["count"])) <= 1 else f"they stopped {times} times"


def _blind(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    """The UAV's position is lost."""
    return _without_position(flown, said, {}, flown.uav_id)


def _lossy(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    # after a silence of some seconds those of before are counted for half a minute
    silences = [flown.silent_s(who, said.t_us - k * S) for k in range(30)]
    return "" if max(silences) > 2.0 else "all its packets have come"


def _stated(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    made = [(act.says, track) for t_us, act, track in flown.acted if act.kind == "state" and t_us <= said.t_us + S]
    return "" if (who, int(fields["track"])) in made else "nobody stated that"


def _contradicted(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    if flown.whose_track(int(fields["track"]), said.t_us) == who:
        return "what was stated is right"
    return _stated(flown, said, fields, who) or _named(flown, said, fields, _id(fields.get("other", "none of ours")))


def _ends(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    return _stated(flown, said, fields, who) or _left(flown, said, fields, who)


def _withdrawn(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    undone = any(act.kind == "undo" and abs(t_us - said.t_us) < S for t_us, act, _ in flown.acted)
    return _stated(flown, said, fields, who) or ("" if undone else "nobody withdrew it")


def _over(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    """An alarm is over when its cause is."""
    raised_us = max((t_us for t_us, text in flown.logged if text == fields["text"] and t_us < said.t_us), default=0)
    lasted_s, told_s = (said.t_us - raised_us) / S, float(fields["seconds"])
    if not lasted_s - HOLD_S - SLACK_S < told_s < lasted_s + 0.6:
        return f"it was raised {lasted_s:.1f} s before" if raised_us else "it was never raised"
    before_us = said.t_us - round(SLACK_S * S)
    cause = check_sentence(flown, replace(said, t_us=before_us, text=fields["text"], ending=True))
    return "" if any(cause) else "its cause goes on"


def _unnamed(flown: TrueFlight, said: Said, fields: Fields, who: int) -> str:
    since_us = said.t_us - round((HOLD_S * said.standing + SLACK_S) * S)
    shown = [moment.snapshot.boxes for moment in flown.moments if since_us <= moment.snapshot.t_us <= said.t_us]
    bare = any(not any(box.system_id and not box.stated for box in boxes) for boxes in shown)
    return "" if bare else "boxes have names"


_LOST, _MAY, _STATED = "track {track} is no longer {name}: ", "may be {name}: ", "stated: track {track} is {name}"
SENTENCES: Mapping[str, Check] = {
    "over after {seconds} s: {text}": _over,
    "{kind} {id} is there, {mode}": _there,
    "gimbal attitude from {text}": _so,
    "camera as the mission has it: {text}": _so,
    "nothing is authenticated: anybody can pose as a vehicle": _open,
    "{name} says: {text}": _speaks,
    "track {track} is {name} ({percent}%)": _named,
    "track {track} is {name} ({percent}%), no longer {other}": _named,
    _LOST + "it left the picture": _left,
    _LOST + "the track was lost": _left,
    _LOST + "it is {other}": _so,
    _LOST + "its positions are lost": _without_position,
    _LOST + "its position stands still": _lies,
    _LOST + "its positions are refused": _lies,
    _LOST + "its positions are refused: {text}": _lies,
    _LOST + "none of ours is likelier ({percent}%)": _stranger,
    _LOST + "the evidence does not suffice": _so,
    _LOST + "the UAV's position is lost": _blind,
    _LOST + "its position contradicts the video": _lies,
    _LOST + "names begin anew": _so,
    "may be {names} or {last}: none of them tells where it is": _lost,
    _MAY + "no position for {seconds} s": _without_position,
    _MAY + "its position has stood still for {seconds} s": _lies,
    _MAY + "never heard": _never_heard,
    _MAY + "all its packets are refused": _forged,
    _MAY + "no position yet": _without_position,
    _MAY + "its positions are refused: {text}": _lies,
    _MAY + "its positions cannot be right": _lies,
    _MAY + "its position contradicts the video": _lies,
    _MAY + "it doubts its own position": _lies,
    "a vehicle of ours is not accounted for": _unaccounted,
    "its position contradicts the video": _one_lies,
    "film and telemetry are not known to belong together": _so,
    "another vehicle reports the same place": _so,
    "another vehicle stands too near to tell by place alone": _so,
    "vehicles have not driven like their boxes for long enough yet": _so,
    "positions err too fast: vehicles are told apart by place alone": _so,
    "not as sure for two seconds yet": _so,
    "its box is probably round two vehicles": _so,
    "its box is predicted, and one that is seen has the name": _so,
    "{name}: never heard": _never_heard,
    "{name}: no heartbeat": _silent,
    "{name}: no heartbeat: its link brings garbled bytes": _silent,
    "{name}: no heartbeat: its link brings garbled bytes, perhaps its own": _silent,
    "{name}: position stale": _without_position,
    "{name}: position lost": _without_position,
    "{name}: its position stands still": _lies,
    "{name}: its position contradicts the video": _lies,
    "{name}: its positions cannot be right: {text}": _lies,
    "{name}: its receiver has no 3D fix": _lies,
    "GPS fix {mode}, was {kind}": _so,
    "position not used: {text}": _lies,
    "position jumped by {count} m and stayed there: accepted": _lies,
    "{name}: its autopilot doubts its position: it jumped": _lies,
    "positions not used: {text}": _lies,
    "{name}: its packets are lost": _lossy,
    "{name}: most of its packets are lost": _lossy,
    "{name}: packets with a wrong signature are rejected": _forged,
    "system {id}: {count} packets refused, bad signature ({text})": _forged,
    "it is not known yet whether video and telemetry match: nothing is named": _unnamed,
    "{link}: nothing is received any more": _link_silent,
    "no video comes": _so,
    "the video has stopped": _stopped,
    "the video comes and goes: {count} times in {within}": _comes_and_goes,
    "{name}: it is heard on and off: {count} times in {within}": _on_and_off,
    "{name}: its positions come and go: {count} times in {within}": _stale_often,
    "{name}: again and again: its position contradicts the video: {count} times in {within}": _lies,
    "never heard: {names}": _unheard,
    _STATED: _stated,
    _STATED + "; it ended with the track": _ends,
    _STATED + "; it ends: that is track {count} now": _stated,
    _STATED + "; withdrawn": _withdrawn,
    _STATED + "; not used: the track has ended": _so,
    _STATED + "; contradicted: by its reports it is {other} ({percent}%)": _contradicted,
    _STATED + "; contradicted: by the reports it is none of ours ({percent}%)": _contradicted,
}
"""The first that fits counts."""
_PATTERNS = tuple((_compiled(template), check) for template, check in SENTENCES.items())


def match_sentence(text: str) -> tuple[Check, Fields] | None:
    """The check of a sentence and its fields, None: no template knows it."""
    found = ((check, match.groupdict()) for pattern, check in _PATTERNS if (match := pattern.fullmatch(text)))
    return next(found, None)


def check_sentence(flown: TrueFlight, said: Said) -> Iterator[str]:
    """Fault of a sentence."""
    if said.text in (act.text for t_us, act, _ in flown.acted if act.kind == "mark" and abs(t_us - said.t_us) < S):
        return
    found = match_sentence(said.text)
    if found is None:
        yield "a sentence that no template knows"
        return
    check, fields = found
    who = _id(fields["name"]) if "name" in fields else int(fields.get("id", said.system_id))
    if said.system_id and "name" in fields and who != said.system_id:
        yield f"it is filed under system id {said.system_id}"
    if why := check(flown, said, fields, who):
        yield why
