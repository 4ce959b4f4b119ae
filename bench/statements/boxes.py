"""What files and messages say of each box: whose it is, or that it is none of ours, and how surely."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

from bench.statements.flights import Flown
from gcs.certainty import CONFIRMED

__all__ = ["Claim", "check_agreement", "check_claims", "check_flips", "read_cot", "read_geojson", "read_identity"]

S = 1_000_000
FLIP_S, TOLD_S, LIKELIER = 0.5, 6.0, 0.5
"""Nobody changes his mind so fast; after so long a silence a vehicle is told of in boxes that are likelier nobody's."""
AGREE = 2e-3
"""Files round to three digits and more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """What one place says of one box in one frame."""

    where: str
    t_us: int
    frame: int
    track: int
    system_id: int
    """0: none of ours."""
    name: str
    confidence: float
    """Of the name, or of "none of ours"."""
    stated: bool = False
    may_be: str = ""
    """Which of ours it may be, and why."""
    doubt: str = ""
    """What lowered the answer."""
    place: tuple[float, float] | None = None
    """Of the box, px, where that is told."""

    def __str__(self) -> str:
        return f"track {self.track} is {self.name or 'none of ours'} {self.confidence:.2f}"


def read_identity(path: Path, where: str = "identity.jsonl") -> list[Claim]:
    """The rows of an ``identity.jsonl``."""
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [
        Claim(
            where=where,
            t_us=row["time_us"],
            frame=row["frame"],
            track=row["track_id"] or 0,
            system_id=row["system_id"] or 0,
            name=row["name"] or "",
            confidence=_number(row["confidence"]),
            stated=row.get("stated", False),
            may_be=row.get("may_be", ""),
            doubt=row.get("doubt", ""),
            place=(row["box"][0], row["box"][1]),
        )
        for row in rows
    ]


def read_geojson(path: Path, by_frame: Mapping[int, int]) -> list[Claim]:
    """The points of a GeoJSON file; ``by_frame``: the time of each frame, Unix µs."""
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    told = [feature["properties"] for feature in features if feature["properties"]["layer"] == "box"]
    return [
        Claim(
            where="GeoJSON",
            t_us=by_frame[row["frame"]],
            frame=row["frame"],
            track=row["track_id"] or 0,
            system_id=row["system_id"] or 0,
            name=row["name"] or "",
            confidence=_number(row["confidence"]),
            stated=row["stated"],
            may_be=row["may_be"] or "",
        )
        for row in told
    ]


def read_cot(events: Iterable[bytes], by_frame: Mapping[int, int]) -> list[Claim]:
    """Cursor on Target events."""
    claims = []
    for event in map(ElementTree.fromstring, events):
        detail, contact = (event.find(f"detail/{name}") for name in ("__rollcall", "contact"))
        assert detail is not None
        assert contact is not None
        system_id, frame = int(detail.get("system_id", 0)), int(detail.attrib["frame"])
        callsign = contact.attrib["callsign"]
        claims.append(
            Claim(
                where="CoT",
                t_us=by_frame[frame],
                frame=frame,
                track=int(detail.attrib["track"]),
                # a friend is one of ours, whatever else is said
                system_id=system_id if event.attrib["type"].startswith("a-f") else 0,
                name="" if callsign.startswith("unknown ") else callsign,
                confidence=_number(detail.get("confidence" if system_id else "none_of_ours")),
                stated="stated" in detail.attrib,
                may_be=detail.get("may_be", ""),
            )
        )
    return claims


def _number(value: float | str | None) -> float:
    return math.nan if value is None else float(value)


def check_claims(flown: Flown, claims: Iterable[Claim]) -> Iterator[tuple[Claim, str]]:
    """Sure names and sure strangers that are neither."""
    for claim in claims:
        frame = flown.frames.get(claim.t_us)
        if frame is None:
            yield claim, "no such frame came"
            continue
        if claim.name != (flown.name(claim.system_id) if claim.system_id else ""):
            yield claim, f"that is the name of no vehicle {claim.system_id}"
        whose = frame.whose(*claim.place) if claim.place else flown.whose_track(claim.track, claim.t_us)
        if claim.place and whose is None:
            yield claim, "no box was found there"
        elif claim.confidence >= CONFIRMED and not claim.stated and whose not in (None, claim.system_id):
            yield claim, f"it is {flown.name(whose or 0)}"
        elif not (claim.system_id or claim.may_be or claim.stated) and _missing(flown, whose or 0, claim):
            yield claim, f"it is {flown.name(whose or 0)}, silent, and nothing says that it may be"


def _missing(flown: Flown, whose: int, claim: Claim) -> bool:
    """Whether a box that is likelier nobody's is that of one who has been silent for long."""
    return bool(whose) and claim.confidence > LIKELIER and flown.silent_s(whose, claim.t_us, "position") > TOLD_S


def check_agreement(first: Iterable[Claim], second: Iterable[Claim]) -> Iterator[tuple[Claim, str]]:
    """What two places say of one box of one frame is the same."""
    by_box = {(claim.frame, claim.track): claim for claim in first if claim.track}
    for claim in second:
        if claim.track and (other := by_box.get((claim.frame, claim.track))) is None:
            yield claim, "nothing else tells of this box"
        elif claim.track and other is not None:
            same = all(
                getattr(claim, name) == getattr(other, name) for name in ("system_id", "name", "stated", "may_be")
            )
            both_unknown = math.isnan(claim.confidence) and math.isnan(other.confidence)
            if not same or not (both_unknown or abs(claim.confidence - other.confidence) <= AGREE):
                yield claim, f"{other.where} has it as {other}"


def check_flips(claims: Iterable[Claim]) -> Iterator[tuple[Claim, str]]:
    """One track is not surely one thing, and surely another half a second later."""
    by_track = defaultdict[int, list[Claim]](list)
    for claim in claims:
        if claim.track and claim.confidence >= CONFIRMED:
            by_track[claim.track].append(claim)
    for sure in by_track.values():
        for before, after in pairwise(sure):
            if before.system_id != after.system_id and after.t_us - before.t_us <= FLIP_S * S and not after.stated:
                yield after, f"{(after.t_us - before.t_us) / S:.1f} s before: {before}"
