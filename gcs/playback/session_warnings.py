"""Warnings of a session before names are trusted: what it lacks, and what of it cannot be used."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcs.playback.opened_session import OpenedSession
from gcs.session.metadata import PROGRAM
from infra.files.segment import segments


def session_warnings(opened: OpenedSession) -> Iterator[str]:
    """One line each; a replay may give other names than the flight where something lacks."""
    yield from opened.log.warnings
    if left := opened.session.unnamed_views:
        yield f"{', '.join(left)}: left aside, since the mission has no [[view]] for what is recorded there"
    for name, skipped in (opened.looks.skipped if opened.looks else {}).items():
        if skipped:
            yield f"{name}: {skipped} rows could not be read and were skipped"
    yield from _of_times(opened)
    if opened.video is not None and opened.video.missing:
        yield f"{opened.video.missing} frames were seen in flight and are not in the recorded video"
    if opened.mission.camera is None or opened.mission.camera.intrinsics is None:
        yield "no [camera] in the mission: boxes are named once the UAV reports its camera, or driving vehicles show it"
    if opened.size.doubt:
        yield opened.size.doubt
    if opened.turns:
        yield from opened.turns.warnings
    yield from _of_a_flight(opened)


def _of_times(opened: OpenedSession) -> Iterator[str]:
    frames = opened.frames
    if frames is not None and frames.skipped:
        yield f"frames.csv: {frames.skipped} rows cannot be used; their frames got the time between others"
    if frames is not None and frames.unordered:
        yield f"frames.csv: {frames.unordered} rows are out of order; they were sorted by frame"
    backwards = int(np.count_nonzero(np.diff(opened.times_us) < 0))
    if backwards:
        yield f"the frames' time goes back {backwards} times: what is named around there is not to be trusted"


def _of_a_flight(opened: OpenedSession) -> Iterator[str]:
    """Inputs that a flight used and its recording lacks."""
    session, log = opened.session, opened.log
    notes, folder = session.notes, session.tlog.parent
    if not notes.flown or session.path.is_file():
        return
    if opened.video is not None and opened.looks is None:
        yield from _other_models(opened)
    elif session.detections is not None and session.folds is None:
        yield "folds.csv is missing: the flight skipped frames and received packets late, and may have named others"
    if len(log) and not segments(folder / "senders.csv"):
        yield "senders.csv is missing: who sent what is unknown, and two senders of one id are distinguished less well"
    for name, rows in notes.lost.items():
        yield f"{name}: {rows} rows of the flight were lost"
    if notes.refused and log.refused != notes.refused:
        yield f"refused.csv: the flight rejected {notes.refused} records, it names {log.refused}"
    if notes.program != PROGRAM:
        yield f"recorded by {notes.program or 'another program'}; this is {PROGRAM}, and names may differ"


def _other_models(opened: OpenedSession) -> Iterator[str]:
    from gcs.fold.detector_factory import fingerprints

    session = opened.session
    now = fingerprints(session.mission.detector) if session.mission else {}
    if not session.notes.models:
        yield "which networks looked at the frames in flight is not recorded; these may be others"
    for name, digest in session.notes.models.items():
        if now.get(name) != digest:
            yield f"the network for {name} is another than in flight"
