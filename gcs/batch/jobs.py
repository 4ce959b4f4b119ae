"""Jobs for a worker and what comes back: plain values, so that pipes and clusters carry them."""

from __future__ import annotations

import json
from importlib.metadata import version
from urllib.parse import quote

import msgspec

IDENTITY_FOLDER, RECORDS, LOGS = "identity", "records", "logs"
FLIGHTS_TABLE = "flights.parquet"
DONE, FAILED = "done", "failed"
SCRATCH_LOG = "flight.log"
"""A flight's log while it is worked on, in its scratch folder."""


def program_version() -> str:
    """Version that is compared to tell whether a result is of this program."""
    return version("rollcall-gcs")


class BatchOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options that a result depends on besides the recording and the program."""

    detect: bool = False
    """Look at the video even where detections were kept."""
    mission: str = ""
    """Absolute path of a mission file for all flights; empty: each has its own."""
    frame_size: tuple[int, int] | None = None
    """Width and height of the frames, px, of recordings that do not know."""

    def text(self) -> str:
        """Options on one line, the same for the same options."""
        kept = {name: value for name, value in msgspec.structs.asdict(self).items() if value and name != "mission"}
        return json.dumps(kept | ({"mission": True} if self.mission else {}), sort_keys=True)


class FlightJob(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """One flight to be named."""

    name: str
    address: str
    """Address of the session folder or telemetry log."""
    out: str
    """Store of the results: as ``gcs.batch.stores.open_results`` takes it."""
    options: BatchOptions = BatchOptions()
    version: str = ""
    """Version of the program that asks: a worker with another refuses."""
    attempt: int = 1
    scratch: str = ""
    """Folder of this machine for what is not whole; its log is there too."""


class FramesDone(msgspec.Struct, frozen=True, tag=True):
    """Progress of the flight that is worked on."""

    done: int
    total: int


class FlightFailed(msgspec.Struct, frozen=True, tag=True):
    """A flight that gave no result."""

    error: str
    """Error in one line: what, where, and what to do."""
    again: bool
    """True if another attempt may help."""
    attempts: int = 1


class VehicleCall(msgspec.Struct, frozen=True, kw_only=True):
    """Row of the roll call: what was seen of one vehicle, null where it was never named."""

    system_id: int
    name: str
    first_named_s: float | None
    boxes: int
    frames_in_view: int
    frames_unknown: int = 0
    """Number of frames in which it is not known whether it was in view; 0 in results of earlier versions."""
    share: float | None = None
    """Share of the frames in view in which a box had its name."""
    confidence: float | None
    outcome: str = ""
    """Outcome, in the roll call's words; empty in results of earlier versions."""
    why: str = ""
    longest_silence_s: float | None = None
    silence_frozen: bool = False
    """True if one position came over and over in that time."""


class ScoreRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Score of the names where the truth is known; null where there is nothing to take a share of."""

    precision: float | None
    coverage: float | None
    right: float | None
    fper: float | None
    switches: int
    idf1: float | None
    track_idf1: float | None
    ece: float | None
    wrong_sure_s: float
    false_strangers: float | None = None
    ece_all: float | None = None


class FlightRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table of flights; null where it is not known, as of a flight that failed."""

    flight: str
    status: str
    """``done`` or ``failed``."""
    error: str | None = None
    """Reason why it failed, on one line."""
    source: str
    version: str
    versions: dict[str, str]
    options: str
    inputs: str | None = None
    """SHA-256 of all files that the result depends on."""
    stamp: str | None = None
    """Stamp of the input's files by their store; null for those of a disk."""
    frames: int | None = None
    skipped_frames: int | None = None
    span_s: float | None = None
    boxes: int | None = None
    unnamed: int | None = None
    vehicles: int | None = None
    named: int | None = None
    alarms: int | None = None
    warnings: int | None = None
    marks: int | None = None
    roll_call: tuple[VehicleCall, ...] = ()
    score: ScoreRecord | None = None
    earlier_result: bool = False
    """Set for a flight that failed: the table of a run before stands still, of other input, version or options."""
    identity_bytes: int | None = None
    """Size of the flight's identity table."""
    attempts: int = 1
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_bytes: int | None = None
    """Most memory that the worker has held so far."""
    worker: str | None = None
    """Host and process id."""


class FlightDone(msgspec.Struct, frozen=True, tag=True):
    """Success of a flight: its result is in place."""

    record: FlightRecord
    skipped: bool
    """True if the result was there before."""
    worker_bytes: int
    """Memory that the worker holds now."""


def file_name(flight: str) -> str:
    """Name of a file, with values in paths as Hive, DuckDB and Arrow write them."""
    return quote(flight, safe=" ")


def identity_name(flight: str) -> str:
    """Name of a flight's identity table in the folder of results."""
    return f"{IDENTITY_FOLDER}/flight={file_name(flight)}/part-0.parquet"


def record_name(flight: str) -> str:
    """Name of a flight's record."""
    return f"{RECORDS}/{file_name(flight)}.json"


def log_name(flight: str) -> str:
    """Name of a flight's log."""
    return f"{LOGS}/{file_name(flight)}.log"
