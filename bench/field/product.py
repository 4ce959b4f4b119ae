"""The product on a session: the recording is opened, folded and logged as ``gcs identify`` does it, both ways."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.playback.analysis import Analysis
from gcs.playback.hindsight import by_hindsight
from gcs.report.score import Matched, match
from gcs.session.event_log import EventLog, read_events
from gcs.session.frame_tables import read_times, read_truth
from gcs.session.identity_log import IdentityLog, read_identity
from gcs.session.session import open_session
from gcs.session.tables import Table
from gcs.snapshot import Snapshot

MISMATCH = "do not match"
"""Words in the text of the alarm that video and telemetry do not belong together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductRun:
    """Result of the product for a session."""

    matched: Matched
    """Boxes and their names as a screen would have shown them."""
    afterwards: Matched
    """The same boxes, named by hindsight."""
    logged: Table
    """The identity log of what a screen would have shown."""
    wall_ms: NDArray[np.float64]
    """(frames,) from one snapshot to the next: reading packets, tracking, naming."""
    cpu_ms: NDArray[np.float64]
    """(frames,) the same in processor time, which other programs on the machine do not add to."""
    accused: frozenset[int]
    """System ids with an alarm that their reports contradict the video."""
    mismatch_s: float
    """Seconds from the first frame to the alarm that video and telemetry do not match; inf never."""


def identify(folder: Path, out: Path, frame_size: tuple[int, int] | None = None) -> ProductRun:
    """Fold a session as ``gcs identify`` does.

    Args:
        folder: of the session.
        out: of its logs, which must not exist.
        frame_size: width and height of the frames, px, where nothing in the session tells.
    """
    analysis = Analysis(open_session(folder, frame_size=frame_size))
    evidence = analysis.keep_evidence()
    wall, cpu, seen = list[float](), list[float](), list[Snapshot]()
    try:
        with IdentityLog(out) as log:
            events = EventLog(out / "events.jsonl")
            snapshots = analysis.snapshots(images=False)
            while True:
                wall_s, cpu_s = time.perf_counter(), time.thread_time()
                snapshot = next(snapshots, None)
                if snapshot is None:
                    break
                wall.append(1e3 * (time.perf_counter() - wall_s))
                cpu.append(1e3 * (time.thread_time() - cpu_s))
                log.write(snapshot)
                events.write(snapshot.events)
                seen.append(snapshot)
            events.close()
        (out / "afterwards").mkdir()
        with IdentityLog(out / "afterwards") as log:
            for snapshot in by_hindsight(seen, analysis.mission, evidence):
                log.write(snapshot)
    finally:
        analysis.close()
    true, logged = read_truth(folder / "truth.csv"), read_identity(out / "identity.csv")
    alarms = [event for event in read_events(out / "events.jsonl")[0] if event.level == "alarm"]
    first_us = float(read_times(folder / "frames.csv").times_us[0])
    return ProductRun(
        matched=match(true, logged),
        afterwards=match(true, read_identity(out / "afterwards" / "identity.csv")),
        logged=logged,
        wall_ms=np.array(wall),
        cpu_ms=np.array(cpu),
        accused=frozenset(e.system_id for e in alarms if e.kind == "identity" and e.system_id),
        mismatch_s=1e-6 * (min((e.t_us for e in alarms if MISMATCH in e.text), default=math.inf) - first_us),
    )
