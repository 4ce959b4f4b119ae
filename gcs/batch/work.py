"""The work on one flight: a recording in, its table and record in their places out. Prints nothing.

A result is of the same input, program and options as what is asked for, or is made again: first its record goes, then
its table is replaced at once, then the new record comes. So whatever is killed when, a record stands beside the table
that it is about.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import platform
import resource
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import psutil

from assoc.errors import AssocError
from gcs.batch.addresses import is_remote, last_part, local_path
from gcs.batch.flights import fetch, files_stamp, input_files, inputs_hash, mission_files, remote_stamp
from gcs.batch.jobs import (
    DONE,
    SCRATCH_LOG,
    BatchOptions,
    FlightDone,
    FlightFailed,
    FlightJob,
    FlightRecord,
    FramesDone,
    ScoreRecord,
    VehicleCall,
    identity_name,
    program_version,
    record_name,
)
from gcs.batch.records import read_record, write_record
from gcs.batch.stores import ResultStore, open_results
from gcs.errors import BatchError, GcsError, StoreError
from gcs.export.tables.parquet import IdentityTable
from gcs.playback.identification import identify_session
from gcs.report.rollcall import RollCall
from gcs.report.score import score_files
from gcs.session.session import Session, open_session
from infra.processes.channel import MessageChannel
from infra.processes.child_process import held_bytes
from infra.program_log import LogFile
from infra.secrets import conceal, concealed, hide
from infra.session_format import IDENTITY, IDENTITY_EVIDENCE
from mavlink.errors import MavlinkError
from sim.errors import SimError
from vision.errors import VisionError

if TYPE_CHECKING:
    from gcs.mission.mission import DetectorChoice
    from vision.detect.detector import Detector

_PACKAGES = ("numpy", "scipy", "onnxruntime", "opencv-python-headless", "av", "pyarrow")
"""Packages on whose versions a result may depend."""
REPORT_S = 0.5
"""Interval of reports of how far a flight is, s."""
_INPUT_ERRORS = (GcsError, MavlinkError, VisionError, AssocError, SimError)
_log = logging.getLogger(__name__)


def identify_flight(job: FlightJob, report: Callable[[int, int], None] = lambda done, total: None) -> FlightDone:
    """Name one flight, where its result is not there yet, and put the result in its place.

    Args:
        job: which, and where to; its scratch folder is there.
        report: called after every frame with the frames that are done, and all there are.

    Returns:
        The flight's record, whether it was there before, and what memory this process holds.

    Raises:
        StoreError: a store does not answer; to try again may help.
        GcsError, MavlinkError, VisionError: the flight cannot be used, or its name is another's.
    """
    if job.version != program_version():
        raise BatchError(
            f"this worker ({_worker()}) has version {program_version()} of Rollcall, the batch {job.version}; "
            "install the same on all machines"
        )
    began_s, cpu_s = time.monotonic(), processor_s()
    results, scratch, source = open_results(job.out), Path(job.scratch), concealed(job.address)
    kept = read_record(results, job.name)
    stamp = remote_stamp(job.address) if is_remote(job.address) else None
    if stamp and kept and kept.stamp == stamp and _is_whole(results, kept, job, kept.inputs):
        return FlightDone(kept, skipped=True, worker_bytes=held_bytes(psutil.Process()))
    path = fetched_path(job) if is_remote(job.address) else local_path(job.address)
    if is_remote(job.address):
        fetch(job.address, path)
    session, files = _open(path, job.options)
    if is_remote(job.address) and session.mission and session.mission.view:
        raise BatchError(f"{source}: of several cameras, which a batch takes from a disk alone: copy it there first")
    as_found, inputs = files_stamp(files), inputs_hash(files)
    if kept and _is_whole(results, kept, job, inputs):
        return FlightDone(kept, skipped=True, worker_bytes=held_bytes(psutil.Process()))
    if kept and kept.status == DONE and kept.source != source and kept.inputs != inputs:
        raise BatchError(
            f"{source}: {concealed(job.out)} has the result of another flight of this name, {kept.source}; "
            f"give one another name, as OTHER={source}, or take another folder for the results"
        )
    _log.info("%s: inputs %s, options %s", source, inputs, job.options.text())
    calls = identify_session(
        session,
        scratch,
        detect=job.options.detect,
        further=False,  # each is a flight of the batch
        report=report,
        note=_log.warning,
        open_detector=_detector,
        looking_threads=0,
    )
    score = _score(session, scratch)
    table = scratch / "part-0.parquet"
    about = {"rollcall.version": job.version, "rollcall.options": job.options.text(), "rollcall.inputs": inputs}
    write_identity_table(scratch / IDENTITY_EVIDENCE, table, about)
    if files_stamp(files) != as_found:
        raise StoreError(f"{source}: was changed while it was read; is it still being recorded?")
    record = FlightRecord(
        flight=job.name,
        status=DONE,
        source=source,
        version=job.version,
        versions=_versions(),
        options=job.options.text(),
        inputs=inputs,
        stamp=stamp,
        frames=calls.frames,
        skipped_frames=calls.skipped_frames,
        span_s=calls.span_s,
        boxes=calls.boxes,
        unnamed=calls.unnamed,
        vehicles=len(calls.rows()),
        named=calls.named,
        alarms=calls.alarms.alarms,
        warnings=calls.alarms.warnings,
        marks=calls.marks,
        roll_call=_roll_call(calls),
        score=score,
        identity_bytes=table.stat().st_size,
        attempts=job.attempt,
        seconds=round(time.monotonic() - began_s, 3),
        cpu_seconds=round(processor_s() - cpu_s, 3),
        peak_bytes=_peak_bytes(),
        worker=_worker(),
    )
    results.remove(record_name(job.name))
    results.put(table, identity_name(job.name))
    write_record(results, record)
    return FlightDone(record, skipped=False, worker_bytes=held_bytes(psutil.Process()))


def fetched_path(job: FlightJob) -> Path:
    """Folder of a flight of a store while it is worked on."""
    last = last_part(job.address)
    return Path(job.scratch) / "input" / (last if last not in ("", ".", "..") else "flight")


def _is_whole(results: ResultStore, kept: FlightRecord, job: FlightJob, inputs: str | None) -> bool:
    """Tell whether a record is of what is asked for, and its table is there."""
    asked = (DONE, inputs, job.version, job.options.text())
    if (kept.status, kept.inputs, kept.version, kept.options) != asked:
        return False
    return results.size(identity_name(job.name)) == kept.identity_bytes


def _open(path: Path, options: BatchOptions) -> tuple[Session, list[Path]]:
    """A recording and all files that its result depends on."""
    if not path.exists():
        raise BatchError(f"{path}: no such session folder or telemetry log on {platform.node()}")
    files = input_files(path)
    mission = Path(options.mission) if options.mission else None
    session = open_session(path, mission=mission, frame_size=options.frame_size)
    if not session.is_first_view:  # telemetry and mission are those above it
        files += input_files(session.tlog.parent)
        if mission and session.mission and not session.mission.view:
            raise BatchError(f"{path}: {mission} has no [[view]], so it does not tell whose camera this is")
    for folder in session.other_folders:  # names rest on what the flight's other cameras saw, too
        files += input_files(folder)
    return session, [*dict.fromkeys(files), *([mission] if mission else []), *mission_files(session.mission)]


@lru_cache(maxsize=2)
def _detector(choice: DetectorChoice) -> Detector:
    """A mission's networks, loaded once by each worker."""
    from gcs.fold.detector_factory import open_mission_detector

    return open_mission_detector(choice)


def _score(session: Session, folder: Path) -> ScoreRecord | None:
    """Score of the names; None where the truth is not known, or not usable."""
    if session.truth is None:
        return None
    try:
        score = asdict(score_files(session.truth, folder / IDENTITY.name))
    except GcsError as error:
        _log.warning("no score: %s", error)
        return None
    known = {name: _known(value) if isinstance(value, float) else value for name, value in score.items()}
    return msgspec.convert(known, ScoreRecord)


def _roll_call(calls: RollCall) -> tuple[VehicleCall, ...]:
    rows = (asdict(row) for row in calls.rows())
    known = ("first_named_s", "share", "confidence")
    return tuple(VehicleCall(**(row | {name: _known(row[name]) for name in known})) for row in rows)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


@lru_cache(maxsize=1)
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _worker() -> str:
    return f"{platform.node()}:{os.getpid()}"


def _peak_bytes() -> int:
    """Most memory that this process alone has held: what the system tells of those that have ended begins with ours."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def processor_s() -> float:
    """Processor time of this process and of those that it started and that have ended, s."""
    return sum(os.times()[:4])


def write_identity_table(evidence: Path, path: Path, about: Mapping[str, str]) -> None:
    """Write a flight's boxes as a Parquet file.

    Args:
        evidence: an ``identity.jsonl``.
        path: of the file, which is replaced.
        about: what the file tells of itself, such as the version of the program.

    Raises:
        GcsError: pyarrow is not installed.
        BatchError: the evidence is none.
    """
    with contextlib.closing(IdentityTable(str(path), about)) as table, evidence.open("rb") as lines:
        for line in lines:
            try:
                table.add(line)
            except msgspec.DecodeError as error:
                raise BatchError(f"{evidence}: {error}") from error


def work_on(job: FlightJob, channel: MessageChannel[FlightJob] | None = None) -> FlightDone | FlightFailed:
    """Work on a flight and log it; no error comes out."""
    hide(job.address)
    hide(job.out)
    due_s = 0.0

    def report(done: int, total: int) -> None:
        nonlocal due_s
        if channel is not None and time.monotonic() >= due_s:
            due_s = time.monotonic() + REPORT_S
            channel.send(FramesDone(done, total))

    if channel is not None:
        channel.send(FramesDone(0, 0))
    log = LogFile(Path(job.scratch) / SCRATCH_LOG)
    try:
        done = identify_flight(job, report)
        _log.info("done: %s frames, %s of %s named", done.record.frames, done.record.named, done.record.vehicles)
        return done
    except StoreError as error:
        return _failed(job, str(error), again=True)
    except _INPUT_ERRORS as error:
        return _failed(job, str(error), again=False)
    except Exception as error:  # noqa: BLE001 - goes to the flight's log and record
        _log.exception("a fault of this program")
        return _failed(job, f"a fault of this program, see the flight's log: {error!r}", again=True)
    finally:
        log.close()


def _failed(job: FlightJob, text: str, *, again: bool) -> FlightFailed:
    line = conceal(" ".join(text.replace(str(fetched_path(job)), job.address).split()))
    _log.error("%s", line)
    return FlightFailed(line, again=again)
