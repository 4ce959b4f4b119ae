"""The sentences that this program says of a flight, with their fields, and when each is true.

A sentence that no template knows is a finding: a checker that passes over what it cannot read can be fooled.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from bench.statements.flights import Flown
from gcs.certainty import CONFIRMED

__all__ = ["Said", "Sentence", "check_sentence", "compiled", "match_sentence"]

S = 1_000_000
SLACK_S = 1.2
"""A turn of the fold, the monitor's half second, a frame that waits for its telemetry, rounding."""
SILENT_S, LOST_S = 3.0, 3.0
"""As ``docs/operations.md`` has it: nothing received for so long, no position for so long."""
LONGEST_HOLD_S = 5.0
"""An alarm may stand for so long after its cause, which has gone for three seconds then."""
FOUND_S = 5.0
"""For so long a vehicle that was found may have to prove itself."""
ADRIFT_S = 3.0
"""Truth of a lie that has ended: reports from before are still in the fold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """A sentence, where it was said, and of what time."""

    where: str
    t_us: int
    text: str
    system_id: int = 0
    standing: bool = False
    """It is said of the present all the while; else once, of what has just come."""


Fields = Mapping[str, str]
Check = Callable[[Flown, Said, Fields], Iterator[str]]


@dataclass(frozen=True, slots=True)
class Sentence:
    """A template and its truth: a check yields what is false, nothing where all is so."""

    template: str
    check: Check


FIELDS = {
    "name": r"UAV|UGV-\d+|none of ours",
    "other": r"UAV|UGV-\d+",
    "names": r"(?:UAV|UGV-\d+)(?:, (?:UAV|UGV-\d+))*",
    "id": r"\d+",
    "track": r"\d+",
    "seconds": r"\d+(?:\.\d+)?",
    "metres": r"\d+(?:\.\d+)? (?:m|km)",
    "percent": r"\d{1,2}(?=%)",
    "count": r"\d+",
    "word": r"[\w ]+",
    "text": r".+",
}


def compiled(template: str) -> re.Pattern[str]:
    """A template as a pattern of the whole sentence: ``{name}`` and the like are typed fields."""
    parts = re.split(r"\{(\w+)\}", template)
    return re.compile(
        "".join(f"(?P<{part}>{FIELDS[part]})" if k % 2 else re.escape(part) for k, part in enumerate(parts))
    )


def _id(name: str) -> int:
    return 0 if name == "none of ours" else 1 if name == "UAV" else int(name.removeprefix("UGV-"))


def _subject(said: Said, fields: Fields) -> int:
    """Whom a sentence is about, by its name, its number, or where it is filed."""
    return _id(fields["name"]) if "name" in fields else int(fields.get("id", said.system_id))


def _so(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    """What no script contradicts."""
    yield from ()


def _there(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    system_id, first_us = int(fields["id"]), min(flown.heartbeats.get(int(fields["id"]), [0]))
    if not first_us:
        yield f"{flown.name(system_id)} was never heard"
    elif not 0 <= said.t_us - first_us < SLACK_S * S:
        yield f"its first heartbeat came at {flown.at_s(first_us):.1f} s"


def _speaks(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    # its words come beside its heartbeats
    if (silent_s := flown.silent_s(_id(fields["name"]), said.t_us)) > SILENT_S:
        yield f"it has been silent for {silent_s:.1f} s"


def _unsigned(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    if flown.script.injected.signed:
        yield "the fleet signs, and the station has its keys"


def _named(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    whose = flown.whose_track(int(fields["track"]), said.t_us)
    if int(fields["percent"]) >= 100 * CONFIRMED and whose not in (None, _id(fields["name"])):
        yield f"it is {flown.name(whose or 0)}"


def _left(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    if (seen_us := flown.seen_later(int(fields["track"]), said.t_us)) and seen_us - said.t_us < S:
        yield f"the track goes on at {flown.at_s(seen_us):.1f} s"


def _stranger(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    whose = flown.whose_track(int(fields["track"]), said.t_us)
    if int(fields["percent"]) >= 100 * CONFIRMED and whose:
        yield f"it is {flown.name(whose)}"


def _without_position(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    age_s = flown.silent_s(_id(fields["name"]), said.t_us, "position")
    if age_s < LOST_S - SLACK_S and not flown.fault_of(_id(fields["name"]), said.t_us, within_s=ADRIFT_S):
        yield f"its last position came {age_s:.1f} s before"


def _no_position_for(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    age_s = flown.silent_s(_id(fields["name"]), said.t_us, "position")
    if abs(float(fields["seconds"]) - age_s) > SLACK_S and not flown.fault_of(_id(fields["name"]), said.t_us):
        yield f"its last position came {age_s:.1f} s before"


def _never_heard(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    if flown.refused.get(_id(fields["name"])) or math.isfinite(flown.silent_s(_id(fields["name"]), said.t_us)):
        yield "it was heard"


def _unaccounted(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    ids = flown.scenario.ugv_ids
    away = any(flown.silent_s(i, said.t_us, "position") > SLACK_S for i in ids) or any(map(flown.refused.get, ids))
    named = {whose for seen in flown.tracks.values() for t_us, whose in seen if 0 <= said.t_us - t_us <= FOUND_S * S}
    if not away and not any(flown.fault_of(i, said.t_us, within_s=FOUND_S) for i in ids) and named >= set(ids):
        yield "all report, and all have been seen"


def _silent(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    looks = range(2 * round(LONGEST_HOLD_S) + 1) if said.standing else range(1)
    silences = [flown.silent_s(_id(fields["name"]), said.t_us - k * S // 2) for k in looks]
    if not any(SILENT_S - 0.1 < silent_s < math.inf for silent_s in silences):
        yield f"it was heard {silences[0]:.1f} s before"


def _lies(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    if flown.fault_of(_subject(said, fields), said.t_us, within_s=said.standing * LONGEST_HOLD_S + ADRIFT_S) is None:
        yield "its positions are right"


def _forged(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    system_id = _subject(said, fields)
    # somebody forges the first vehicle of a fleet that signs
    if not (flown.refused.get(system_id) or (flown.script.injected.signed and system_id == flown.scenario.ugv_ids[0])):
        yield "all its packets are rightly signed"


def _video(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    hold_us = round(LONGEST_HOLD_S * S) if said.standing else 0
    frames = [t_us for now_us, t_us in flown.turns if said.t_us - hold_us - S <= now_us <= said.t_us and t_us]
    if len(frames) > 0.8 * (hold_us / S + 1.0) * flown.script.fps:
        yield f"{len(frames)} frames came in the {hold_us / S + 1:.0f} s before"


def _unheard(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    told = {_id(name) for name in fields["names"].split(", ")}
    candidates = [i for i in flown.scenario.ugv_ids if not flown.refused.get(i)]
    now, before = (
        {i for i in candidates if math.isinf(flown.silent_s(i, said.t_us - round(ago_s * S)))}
        for ago_s in (-SLACK_S, SLACK_S)
    )
    if not now <= told <= before:
        yield f"never heard were {sorted(map(flown.name, now))}"


def _stated(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    acts = [(t_us, act) for t_us, act, track in flown.acted if act.kind == "state" and track == int(fields["track"])]
    if not any(act.says == _id(fields["name"]) and t_us <= said.t_us + S for t_us, act in acts):
        yield "nobody stated that"


def _ends(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    yield from _stated(flown, said, fields)
    yield from _left(flown, said, fields)


def _withdrawn(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    yield from _stated(flown, said, fields)
    if not any(act.kind == "undo" and abs(t_us - said.t_us) < S for t_us, act, _ in flown.acted):
        yield "nobody withdrew it"


def _over(flown: Flown, said: Said, fields: Fields) -> Iterator[str]:
    """An alarm is over when its cause is."""
    before_us = max((t_us for t_us, text in flown.logged if text == fields["text"] and t_us < said.t_us), default=0)
    lasted_s, told_s = (said.t_us - before_us) / S, float(fields["seconds"])
    if not before_us:
        yield "it was never raised"
    elif not lasted_s - LONGEST_HOLD_S - SLACK_S < told_s < lasted_s + 0.6:
        yield f"it was raised {lasted_s:.1f} s before"
    found = match_sentence(fields["text"])
    if found is None:
        yield "no sentence that is known"
    elif not list(found[0].check(flown, Said(where=said.where, t_us=said.t_us, text=fields["text"]), found[1])):
        yield "its cause goes on"


NO_LONGER = "track {track} is no longer {name}: "
STATED = "stated: track {track} is {name}"
SENTENCES = (
    Sentence("over after {seconds} s: {text}", _over),
    Sentence("{word} {id} is there, {word2}", _there),
    Sentence("gimbal attitude from {text}", _so),
    Sentence("camera as the mission has it: {text}", _so),
    Sentence("nothing is authenticated: anybody can pose as a vehicle", _unsigned),
    Sentence("{name} says: {text}", _speaks),
    Sentence("track {track} is {name} ({percent}%)", _named),
    Sentence("track {track} is {name} ({percent}%), no longer {other}", _named),
    Sentence(NO_LONGER + "it left the picture", _left),
    Sentence(NO_LONGER + "the track was lost", _left),
    Sentence(NO_LONGER + "it is {other}", _so),
    Sentence(NO_LONGER + "its positions are lost", _without_position),
    Sentence(NO_LONGER + "its positions are refused", _lies),
    Sentence(NO_LONGER + "its positions are refused: {text}", _lies),
    Sentence(NO_LONGER + "none of ours is likelier ({percent}%)", _stranger),
    Sentence(NO_LONGER + "the evidence does not suffice", _so),
    Sentence("may be {name}: no position for {seconds} s", _no_position_for),
    Sentence("may be {name}: never heard", _never_heard),
    Sentence("may be {name}: all its packets are refused", _forged),
    Sentence("may be {name}: no position yet", _without_position),
    Sentence("may be {name}: its positions are refused: {text}", _lies),
    Sentence("may be {name}: its position contradicts the video", _lies),
    Sentence("a vehicle of ours is not accounted for", _unaccounted),
    *(
        Sentence(doubt, _so)
        for doubt in (
            "film and telemetry are not known to belong together",
            "another vehicle reports the same place",
            "another vehicle stands too near to tell by place alone",
            "vehicles have not driven like their boxes for long enough yet",
            "not as sure for two seconds yet",
            "its box is probably round two vehicles",
            "its box is predicted, and one that is seen has the name",
        )
    ),
    Sentence("{name}: no heartbeat", _silent),
    Sentence("{name}: position stale", _without_position),
    Sentence("{name}: position lost", _without_position),
    Sentence("{name}: its position contradicts the video", _lies),
    Sentence("{name}: its positions cannot be right: {text}", _lies),
    Sentence("position not used: {text}", _lies),
    Sentence("positions not used: {text}", _lies),
    Sentence("{name}: packets with a wrong signature are rejected", _forged),
    Sentence("system {id}: {count} packets refused, bad signature ({text})", _forged),
    Sentence("the video has stopped", _video),
    Sentence("never heard: {names}", _unheard),
    Sentence(STATED, _stated),
    Sentence(STATED + "; it ends with the track", _ends),
    Sentence(STATED + "; it ends: that is track {count} now", _stated),
    Sentence(STATED + "; withdrawn", _withdrawn),
    Sentence(STATED + "; contradicted: by its reports it is {other} ({percent}%)", _stated),
    Sentence(STATED + "; contradicted: by the reports it is none of ours ({percent}%)", _stated),
)
"""The most special first."""
FIELDS["word2"] = FIELDS["word"]
_PATTERNS = tuple((compiled(sentence.template), sentence) for sentence in SENTENCES)


def match_sentence(text: str) -> tuple[Sentence, Fields] | None:
    """The template of a sentence and its fields, None: it is not known."""
    for pattern, sentence in _PATTERNS:
        if match := pattern.fullmatch(text):
            return sentence, match.groupdict()
    return None


def check_sentence(flown: Flown, said: Said) -> Iterator[str]:
    """What is false about a sentence."""
    if said.text in (act.text for t_us, act, _ in flown.acted if act.kind == "mark" and abs(t_us - said.t_us) < S):
        return
    found = match_sentence(said.text)
    if found is None:
        yield "a sentence that no template knows"
        return
    sentence, fields = found
    if said.system_id and "name" in fields and _id(fields["name"]) != said.system_id:
        yield f"it is filed under system id {said.system_id}"
    yield from sentence.check(flown, said, fields)
