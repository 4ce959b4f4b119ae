"""Candidates for a box, in words: the likeliest vehicles, and what speaks against each."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

from assoc.identification.doubts import AnswerDoubt
from assoc.records import Candidates, Identities
from gcs.certainty import CONFIRMED, certainty
from gcs.health.heard import is_heard, refused_because
from gcs.health.vehicle_alarms import CONTRADICTED, DOUBTED
from gcs.snapshot import Candidate
from mavlink.state import FleetState, VehicleStatus

OLD_S = 2.0
"""A report older than this does not count as where the vehicle is: at 5 m/s it has gone ten metres."""
FAR_DEVIATIONS = 3.0
"""Deviations beyond which a box is too far: one that belongs to the vehicle is in one of ninety cases (two axes)."""
MIN_SHOWN = 0.01
"""Probability below which 0 % is shown: nothing is called likelier than others beside that."""
MAX_REASONS = 2
"""Most reasons on a line, the weightiest first."""
_WORDS = {
    AnswerDoubt.NONE: "",
    AnswerDoubt.FIT: "film and telemetry are not known to belong together",
    AnswerDoubt.DOUBLE: "another vehicle reports the same place",
    AnswerDoubt.PLACE: "another vehicle stands too near to tell by place alone",
    AnswerDoubt.UNPROVEN: "vehicles have not driven like their boxes for long enough yet",
    AnswerDoubt.WANDERING: "positions err too fast: vehicles are told apart by place alone",
    AnswerDoubt.MISSING: "a vehicle of ours is not accounted for",
    AnswerDoubt.UNSTEADY: "not as sure for two seconds yet",
    AnswerDoubt.COMMON_BOX: "its box is probably round two vehicles",
    AnswerDoubt.ELSEWHERE: "by what another camera sees it is somebody else",
    AnswerDoubt.COASTING: "its box is predicted, and one that is seen has the name",
    AnswerDoubt.OWN_WORD: DOUBTED,
    AnswerDoubt.CONTESTED: "several senders use its id",
    AnswerDoubt.CONTRADICTED: CONTRADICTED,
}


def doubt_words(identities: Identities) -> list[str]:
    """Reasons that took most from the probability of each answer that is not sure, in words; empty: nothing."""
    columns = identities.doubt.tolist(), identities.confidence.tolist()
    return ["" if sure >= CONFIRMED else _WORDS[AnswerDoubt(doubt)] for doubt, sure in zip(*columns, strict=True)]


class CandidateWords:
    """The candidates in words, made again when the identifier has compared again."""

    def __init__(self, threshold: float) -> None:
        self._threshold = threshold
        self._explained: Candidates | None = None
        self._names: list[int] = []
        self._words: list[tuple[Candidate, ...]] = []

    def of(
        self, identities: Identities | None, state: FleetState, contradicted: Collection[int] = ()
    ) -> Sequence[tuple[Candidate, ...]]:
        """The candidates of each track, in the order of the identities.

        Args:
            identities: of a frame, None without a camera pose.
            state: the fleet.
            contradicted: vehicles whose positions contradict the video.
        """
        if identities is None:
            return ()
        names = identities.system_id.tolist()
        if identities.candidates is not self._explained or names != self._names:
            self._explained, self._names = identities.candidates, names
            self._words = _in_words(identities, state, self._threshold, contradicted)
        return self._words


def _in_words(
    identities: Identities, state: FleetState, threshold: float, contradicted: Collection[int]
) -> list[tuple[Candidate, ...]]:
    """The candidates of each track; ``threshold``: least confidence of a name."""
    status = {each.system_id: each for each in state.vehicles}
    rows = identities.candidates
    names, sure = identities.system_id.tolist(), identities.confidence.tolist()
    by_track = dict(zip(identities.track_id.tolist(), names, strict=True))
    none = rows.none_of_ours.tolist()
    found = []
    for track, ids in enumerate(rows.system_id.tolist()):
        numbers = zip(
            ids,
            rows.confidence[track].tolist(),
            rows.distance_m[track].tolist(),
            rows.deviation[track].tolist(),
            rows.report_age_s[track].tolist(),
            rows.better_track[track].tolist(),
            rows.better_confidence[track].tolist(),
            strict=True,
        )
        row = []
        for vehicle, confidence, distance_m, deviation, age_s, better, better_sure in numbers:
            own = vehicle == names[track]
            missing = missing_because(status.get(vehicle), age_s, contradicted=vehicle in contradicted)
            reasons = [missing] * bool(missing)
            # from a place where it was long ago any box is far
            of_reports = _of_its_reports(status.get(vehicle), distance_m, deviation, age_s)
            reasons += [why for why in of_reports if why != missing]
            if better and not own:
                reasons.append(_better_box(better_sure, has_name=by_track.get(better) == vehicle))
            if not own:
                reasons += _of_its_rivals(confidence, none[track], threshold, better=bool(better))
            row.append(
                Candidate(
                    system_id=vehicle,
                    # the one number that decides: after all doubts about the vehicle
                    confidence=sure[track] if own else confidence,
                    distance_m=distance_m if age_s <= OLD_S else math.nan,
                    against=", ".join(reasons[:MAX_REASONS]),
                    missing=missing,
                )
            )
        found.append(tuple(row))
    return found


def missing_because(status: VehicleStatus | None, age_s: float, *, contradicted: bool) -> str:
    """Return why a vehicle's reports do not tell where it is; empty: they do.

    Args:
        status: the vehicle, None unknown.
        age_s: of its last report that was used, s, inf never.
        contradicted: whether the video shows that it is elsewhere.
    """
    if status is None:
        return "never heard"
    refused = refused_because(status)
    if status.contested or not math.isnan(status.held_s):
        return refused
    if not is_heard(status):
        return "all its packets are refused" if refused else "never heard"
    if status.position_state == "refused":
        return f"its positions are refused: {refused}" if status.refused_for else refused
    if math.isinf(age_s):
        return "no position yet"
    if age_s > OLD_S:
        # positions that it doubts come, and are not used
        doubts = status.doubted_for and status.position_age_s <= OLD_S
        stands = f"its position has stood still for {age_s:.0f} s" if status.frozen else ""
        return DOUBTED if doubts else stands or f"no position for {age_s:.0f} s"
    return CONTRADICTED if contradicted else ""


def _of_its_reports(status: VehicleStatus | None, distance_m: float, deviation: float, age_s: float) -> Iterator[str]:
    """Fault of the place where a vehicle's reports put it."""
    if deviation > FAR_DEVIATIONS and age_s <= OLD_S:
        yield f"too far: up to {FAR_DEVIATIONS * distance_m / deviation:.1f} m is usual"
    if status is not None and status.doubted_for:
        yield DOUBTED


def _better_box(sure: float, *, has_name: bool) -> str:
    """Words for a box that the vehicle rather is, which has its name or not."""
    return f"another box {'has its name' if has_name else 'fits it better'} ({certainty(sure)})"


def _of_its_rivals(confidence: float, none_of_ours: float, threshold: float, *, better: bool) -> Iterator[str]:
    """Answer that is likelier than that the box is this vehicle."""
    if none_of_ours > confidence and none_of_ours >= MIN_SHOWN:
        yield "none of ours is likelier"
    elif confidence < threshold and not better:
        yield f"not sure enough: {certainty(threshold)} needed"
