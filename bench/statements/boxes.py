"""Claims of files and messages about each box: whose it is, or that it is none of ours, and how surely."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from bench.flights import TrueFlight
from gcs.certainty import CONFIRMED

S = 1_000_000
FLIP_S, TOLD_S, LIKELIER = 0.5, 6.0, 0.5
"""Nobody changes his mind so fast; after so long a silence a vehicle is told of in boxes that are likelier nobody's."""
AGREE = 2e-3
"""Files round to three digits and more."""
Found = Iterator[tuple["Claim", str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Claim of one place about one box in one frame."""

    where: str
    t_us: int
    frame: int
    track_id: int = 0
    system_id: int = 0
    """0: none of ours."""
    name: str = ""
    confidence: float = math.nan
    """Probability of the name, or of "none of ours"."""
    stated: bool = False
    may_be: str = ""
    """Vehicle of ours that it may be, and why."""
    doubt: str = ""
    """Reason that lowered the answer."""
    place: tuple[float, float] | None = None
    """Centre of the box, px, where that is told."""

    def __str__(self) -> str:
        return f"track {self.track_id} is {self.name or 'none of ours'} {self.confidence:.2f}"


def _claim(where: str, t_us: int, row: Mapping[str, Any], box: list[float] | None = None) -> Claim:
    """Claim of a row; what is null is not told."""
    told = {each.name: row[each.name] for each in fields(Claim) if row.get(each.name) is not None}
    return Claim(where=where, t_us=t_us, **told, place=(box[0], box[1]) if box else None)


def read_identity(path: Path) -> list[Claim]:
    """The rows of an ``identity.jsonl``."""
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return [_claim("identity.jsonl", row["time_us"], row, row["box"]) for row in rows]


def read_geojson(path: Path, by_frame: Mapping[int, int]) -> list[Claim]:
    """The points of a GeoJSON file; ``by_frame``: the time of each frame, Unix µs."""
    rows = [feature["properties"] for feature in json.loads(path.read_text(encoding="utf-8"))["features"]]
    return [_claim("GeoJSON", by_frame[row["frame"]], row) for row in rows if row["layer"] == "box"]


def read_cot(events: Iterable[bytes], by_frame: Mapping[int, int]) -> list[Claim]:
    """Cursor on Target events: a friend is one of ours, whatever else is said."""
    claims = []
    for event in map(ElementTree.fromstring, events):
        told = {key: value for part in event.iterfind("detail/*") for key, value in part.attrib.items()}
        ours, frame = event.attrib["type"].startswith("a-f"), int(told["frame"])
        row: dict[str, Any] = {"frame": frame, "track_id": int(told["track"]), "stated": "stated" in told}
        row |= {"system_id": int(told["system_id"]), "name": told["callsign"]} if ours else {}
        row |= {
            key: float(told[name])
            for key, name in [("confidence", ("none_of_ours", "confidence")[ours])]
            if name in told
        }
        claims.append(_claim("CoT", by_frame[frame], row | {"may_be": told.get("may_be", "")}))
    return claims


def check_claims(flown: TrueFlight, claims: Iterable[Claim]) -> Found:
    """Sure names and sure strangers that are neither."""
    for claim in claims:
        frame = flown.frames.get(claim.t_us)
        if frame is None:
            yield claim, "no such frame came"
            continue
        if claim.name != (flown.name(claim.system_id) if claim.system_id else ""):
            yield claim, f"that is the name of no vehicle {claim.system_id}"
        whose = frame.whose(*claim.place) if claim.place else flown.whose_track(claim.track_id, claim.t_us)
        if claim.place and whose is None:
            yield claim, "no box was found there"
        elif claim.confidence >= CONFIRMED and not claim.stated and whose not in (None, claim.system_id):
            yield claim, f"it is {flown.name(whose or 0)}"
        elif not (claim.system_id or claim.may_be or claim.stated) and _missing(flown, whose or 0, claim):
            yield claim, f"it is {flown.name(whose or 0)}, silent, and nothing says that it may be"


def _missing(flown: TrueFlight, whose: int, claim: Claim) -> bool:
    """True if a box that is likelier nobody's is that of one who has been silent for long."""
    return bool(whose) and claim.confidence > LIKELIER and flown.silent_s(whose, claim.t_us, "position") > TOLD_S


def check_agreement(first: Iterable[Claim], second: Iterable[Claim]) -> Found:
    """Check that two places say the same of one box of one frame."""
    by_box = {(claim.frame, claim.track_id): claim for claim in first}
    for claim in second:
        if not claim.track_id:
            continue
        other = by_box.get((claim.frame, claim.track_id))
        if other is None:
            yield claim, "nothing else tells of this box"
            continue
        same = all(getattr(claim, name) == getattr(other, name) for name in ("system_id", "name", "stated", "may_be"))
        # of a name that is withheld one place tells no number, another what little speaks for a stranger
        unknown = math.isnan(other.confidence) and not claim.confidence >= CONFIRMED
        if not same or not (unknown or abs(claim.confidence - other.confidence) <= AGREE):
            yield claim, f"{other.where} has it as {other}"


def check_flips(claims: Iterable[Claim]) -> Found:
    """One track is not surely one thing, and surely another half a second later."""
    by_track = defaultdict[int, list[Claim]](list)
    for claim in claims:
        if claim.track_id and claim.confidence >= CONFIRMED:
            by_track[claim.track_id].append(claim)
    for before, after in (pair for sure in by_track.values() for pair in pairwise(sure)):
        if before.system_id != after.system_id and after.t_us - before.t_us <= FLIP_S * S and not after.stated:
            yield after, f"{(after.t_us - before.t_us) / S:.1f} s before: {before}"
