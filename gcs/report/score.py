"""The score of an identity log against the truth.

Boxes of the log are matched to true boxes frame by frame (nearest centres, one to one, within half a box). Then
    precision = right names / names given                          (a name on something that is not ours is wrong)
    coverage  = named boxes of ours / boxes of ours in the truth
    right     = right names / boxes of ours in the truth
    FPER      = false targets left unnamed / false targets          (Chen, Du, Wu 2025, section 4.1.3, per box)
    switches  = times a vehicle's name changed from one id to another
    IDF1      = 2 IDTP / (2 IDTP + IDFP + IDFN)                     (Ristani et al. 2016, arXiv 1609.01775)
                of the names, a vehicle's own id being the only one that counts; and of the bare tracks, each paired
                with the vehicle it followed longest, where a vehicle that left and came back counts against the track
    false strangers = boxes of ours / boxes said to be none of ours at confidence ≥ 0.9
    ECE       = Σ_bins share · |mean confidence - share right|      over named boxes, 10 bins (Guo et al. 2017)
    ECE of all: the same over all boxes with an answer; "none of ours" is right of what is not ours
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from gcs.errors import ScoreError
from gcs.session.frame_tables import read_truth
from gcs.session.identity_log import read_identity
from gcs.session.tables import Table

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Matched:
    """True boxes and the log's names for them: a row for each pair, then those without a partner on either side."""

    frame: IntArray
    """(k,)"""
    time_us: FloatArray
    """(k,) of the frame, NaN where the log has no row in it."""
    truth: IntArray
    """(k,) true system id, 0 a false target, -1 a logged box with no true box under it."""
    named: IntArray
    """(k,) system id in the log, 0 unnamed, -1 a true box that the log lacks."""
    track: IntArray
    """(k,) track id in the log, 0 none."""
    confidence: FloatArray
    """(k,) NaN unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Score of names against the truth; shares are NaN when there is nothing to take a share of."""

    frames: int
    ours: int
    """True boxes of our vehicles."""
    false_targets: int
    """True boxes of false targets, and logged boxes over nothing."""
    named: int
    precision: float
    coverage: float
    right: float
    fper: float
    switches: int
    idf1: float
    """IDF1 of the names."""
    track_idf1: float
    """IDF1 of the tracks."""
    ece: float
    """Expected calibration error of the names."""
    ece_all: float
    """Expected calibration error of all answers: also that a box without a name is none of ours."""
    wrong_sure_s: float
    """Vehicle-seconds with a wrong name at confidence ≥ 0.9."""
    false_strangers: float
    """Share that is ours of the boxes said to be none of ours at confidence ≥ 0.9."""
    frames_unlogged: int
    """Frames with true boxes of which the log has none, as where nobody looked: their boxes count as not named."""
    skipped: int = 0
    """Rows of either file that could not be used."""


def score_files(truth: Path, identity: Path) -> Score:
    """Score an identity log against ``truth.csv``.

    Raises:
        ScoreError, SessionError: as of ``match_files``.
    """
    matched, skipped = match_files(truth, identity)
    return replace(score(matched), skipped=skipped)


def match_files(truth: Path, identity: Path) -> tuple[Matched, int]:
    """Pair the boxes of an identity log with those of ``truth.csv``.

    Returns:
        the pairs, and how many rows of either file could not be used.

    Raises:
        ScoreError: the two have no frame in common.
        SessionError: a file is missing or lacks a column.
    """
    true = read_truth(truth)
    logged = read_identity(identity)
    if not len(true):
        raise ScoreError(f"{truth}: no true box in it, nothing to compare with")
    if len(logged) and not np.intersect1d(true["frame"], logged["frame"]).size:
        raise ScoreError(f"{identity} and {truth} have no frame in common; are they of the same recording?")
    return match(true, logged), true.skipped + logged.skipped


def match(true: Table, logged: Table) -> Matched:
    """Pair the boxes of the log with the true ones, frame by frame."""
    true_order, logged_order = np.argsort(true["frame"], kind="stable"), np.argsort(logged["frame"], kind="stable")
    true_frame, logged_frame = true["frame"][true_order], logged["frame"][logged_order]
    rows: list[tuple[float, float, float, float, float, float]] = []
    for frame in np.union1d(true_frame, logged_frame):
        t = true_order[slice(*np.searchsorted(true_frame, (frame, frame + 1)))]
        s = logged_order[slice(*np.searchsorted(logged_frame, (frame, frame + 1)))]
        pairs = _pairs(true, logged, t, s)
        time = logged["time_us"][s[0]] if len(s) else np.nan
        for i, j in pairs:
            rows.append(
                (
                    frame,
                    time,
                    true["system_id"][i],
                    _zero(logged["system_id"][j]),
                    _zero(logged["track_id"][j]),
                    logged["confidence"][j],
                )
            )
        rows += [(frame, time, true["system_id"][i], -1, 0, np.nan) for i in sorted(set(t) - {i for i, _ in pairs})]
        for j in sorted(set(s) - {j for _, j in pairs}):
            rows.append(
                (frame, time, -1, _zero(logged["system_id"][j]), _zero(logged["track_id"][j]), logged["confidence"][j])
            )
    a = np.array(rows, dtype=np.float64).reshape(len(rows), 6)
    frame, truth, named, track = (a[:, k].astype(np.int64) for k in (0, 2, 3, 4))
    return Matched(frame=frame, time_us=a[:, 1], truth=truth, named=named, track=track, confidence=a[:, 5])


def _zero(value: float) -> float:
    return 0.0 if np.isnan(value) else value


def _pairs(true: Table, logged: Table, t: IntArray, s: IntArray) -> list[tuple[int, int]]:
    """One-to-one nearest centres; a pair may lie half the longer side of the true box apart, at least 8 px."""
    if not len(t) or not len(s):
        return []
    d = np.hypot(true["cx"][t][:, None] - logged["cx"][s], true["cy"][t][:, None] - logged["cy"][s])
    reach = np.maximum(0.5 * np.maximum(true["w"][t], true["h"][t]), 8.0)[:, None]
    i, j = linear_sum_assignment(np.where(d <= reach, d, 1e6))
    return [(int(t[a]), int(s[b])) for a, b in zip(i, j, strict=True) if d[a, b] <= reach[a, 0]]


def score(m: Matched) -> Score:
    """Sum up matched boxes."""
    ours, named = m.truth > 0, m.named > 0
    right = ours & (m.named == m.truth)
    wrong = named & ~right
    false = m.truth <= 0
    sure = wrong & (m.confidence >= 0.9)
    stranger = (m.named == 0) & (m.confidence >= 0.9)
    return Score(
        frames=len(np.unique(m.frame)),
        ours=int(ours.sum()),
        false_targets=int(false.sum()),
        named=int(named.sum()),
        precision=_share(right, named),
        coverage=_share(ours & named, ours),
        right=_share(right, ours),
        fper=_share(false & ~named, false),
        switches=_switches(m),
        idf1=float(2 * right.sum() / max(ours.sum() + named.sum(), 1)),
        track_idf1=_track_idf1(m),
        ece=_ece(m.confidence[named], right[named]),
        ece_all=_ece(m.confidence, right_answers(m)),
        wrong_sure_s=float(sure.sum()) * _frame_period_s(m),
        false_strangers=_share(ours & stranger, stranger),
        frames_unlogged=len(np.setdiff1d(m.frame, m.frame[m.named >= 0])),
    )


def right_answers(m: Matched) -> NDArray[np.bool_]:
    """(k,) whether each box has its own name, or none where it is not ours."""
    return np.asarray(m.named == np.maximum(m.truth, 0), bool)


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    return float(part.sum() / whole.sum()) if whole.any() else float("nan")


def _frame_period_s(m: Matched) -> float:
    times = np.unique(m.time_us[np.isfinite(m.time_us)])
    return float(np.median(np.diff(times))) * 1e-6 if len(times) > 1 else 0.0


def _switches(m: Matched) -> int:
    total = 0
    for vehicle in np.unique(m.truth[m.truth > 0]):
        names = m.named[(m.truth == vehicle) & (m.named > 0)]
        total += int((np.diff(names) != 0).sum())
    return total


def _track_idf1(m: Matched) -> float:
    """Best one-to-one pairing of whole tracks with whole vehicles, by frames in common."""
    tracked = m.track > 0
    vehicles, tracks = np.unique(m.truth[m.truth > 0]), np.unique(m.track[tracked])
    if not len(vehicles):
        return float("nan")
    common = np.zeros((len(vehicles), len(tracks)))
    both = tracked & (m.truth > 0)
    np.add.at(common, (np.searchsorted(vehicles, m.truth[both]), np.searchsorted(tracks, m.track[both])), 1)
    i, j = linear_sum_assignment(-common)
    truths, tracked_boxes = (m.truth > 0).sum(), both.sum()
    return float(2 * common[i, j].sum() / (truths + tracked_boxes))


def _ece(confidence: FloatArray, right: NDArray[np.bool_]) -> float:
    known = np.isfinite(confidence)
    if not known.any():
        return float("nan")
    confidence, right = confidence[known], right[known]
    bins = np.minimum((confidence * 10).astype(np.int64), 9)
    gaps = [abs(confidence[bins == b].sum() - right[bins == b].sum()) for b in range(10)]
    return float(sum(gaps) / len(confidence))
