"""Naming the boxes of a recording: a session in, its identity log and roll call out. Prints nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gcs.errors import SessionError
from gcs.playback.analysis import Analysis
from gcs.report.rollcall import RollCall
from gcs.session.event_log import EventLog
from gcs.session.identity_log import IdentityLog
from gcs.session.session import Session
from gcs.snapshot import Snapshot

__all__ = ["identify_session"]


def identify_session(
    session: Session,
    out: Path,
    *,
    detect: bool = False,
    report: Callable[[int, int], None] = lambda done, total: None,
    note: Callable[[str], None] = lambda text: None,
) -> RollCall:
    """Fold a session and write ``identity.csv``, ``identity.jsonl`` and ``events.jsonl``; same input, same bytes.

    Args:
        session: as ``gcs.session.session.open_session`` gives it.
        out: folder of the files, which must not be there yet; made where it is missing.
        detect: look at the video even if detections were kept.
        report: called after every frame with the frames that are done, and all there are.
        note: called with each line that a user should read: what the recording lacks, what the camera's stream did,
            what was not known in the end.

    Returns:
        Who was named when, and in how many boxes.

    Raises:
        SessionError: no frame in it, or files of these names in ``out``.
        ConfigError, ModelError, LogError: mission, detector or telemetry cannot be used.
    """
    analysis = Analysis(session, redetect=detect)
    for text in analysis.warnings:
        note(text)
    calls = RollCall(analysis.mission)
    last: Snapshot | None = None
    blind = False
    try:
        with IdentityLog(out) as log:
            events = EventLog(out / "events.jsonl")
            for last in analysis.snapshots(images=False):
                log.write(last)
                events.write(last.events)
                calls.add(last)
                for event in last.events:
                    if event.kind == "video" and event.level == "info":
                        note(event.text)
                report(calls.frames, len(analysis.times_us))
                blind |= last.pose == "no attitude"
            events.close()
    finally:
        analysis.close()
    if last is None:
        raise SessionError(f"{session.path}: not one frame in it")
    for text in _doubts(last, calls, blind=blind):
        note(text)
    return calls


def _doubts(last: Snapshot, calls: RollCall, *, blind: bool) -> list[str]:
    """What an operator should know about inputs that were lacking; blind: the attitude was all that lacked once."""
    doubts = []
    uav = last.vehicles[0]
    if uav.position_state == "never":
        doubts.append(f"the UAV (system id {uav.system_id}) never reported a position: nothing can be placed or named")
    elif blind and calls.attitude_frames == 0:
        doubts.append("the UAV never reported its attitude: names rest on motion alone and take longer")
    silent = [row.name for row in last.vehicles[1:] if row.position_state == "never"]
    if silent:
        doubts.append(f"no position was ever reported by {', '.join(silent)}: they cannot be named")
    if not calls.boxes:
        doubts.append("not one vehicle was detected in the video")
    return doubts
