"""A recorded flight for other people's programs: snapshots, names as a table, and their score."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SessionError
from gcs.export.tables.named_boxes import NamedBoxes
from gcs.mission.mission import Mission
from gcs.playback.analysis import Analysis
from gcs.playback.discovery import discover
from gcs.playback.identification import identify_session
from gcs.report.score import Score, match, score, score_files
from gcs.session.frame_tables import read_truth
from gcs.session.log import SessionLog
from gcs.session.session import Session, open_session
from gcs.session.tables import Table
from gcs.snapshot import Snapshot
from infra.session_format import IDENTITY_EVIDENCE
from vision.detect.detections import Detections
from vision.detect.detector import Detector

Image = NDArray[np.uint8]
Detect = Callable[[Image], Detections]


class FlightRecording:
    """A session, or a telemetry log with its film. Iterating gives one snapshot a frame, without images.

    Attributes:
        session: its files.
        mission: who flew, from its mission file or from the log's heartbeats.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.mission: Mission = session.mission or discover(SessionLog(session.tlog, session.notes.had_key_for))

    @property
    def truth(self) -> Path:
        """``truth.csv`` of a simulated or annotated flight.

        Raises:
            SessionError: there is none.
        """
        if self.session.truth is None:
            raise SessionError(
                f"{self.session.path}: no truth.csv in it; only simulated and annotated flights have one"
            )
        return self.session.truth

    def __iter__(self) -> Iterator[Snapshot]:
        return self.snapshots()

    def snapshots(self, *, images: bool = False) -> Iterator[Snapshot]:
        """One snapshot a frame, as a screen would have shown it.

        Args:
            images: Decode the film too, and put each frame's image into its snapshot.

        Raises:
            GcsError, MavlinkError, VisionError: A part of the flight cannot be used.
        """
        with contextlib.closing(Analysis(self.session)) as analysis:
            yield from analysis.snapshots(images=images)

    def identify(
        self,
        *,
        detector: Detect | Detector | None = None,
        detect: bool = False,
        hindsight: bool | None = None,
        out: Path | str | None = None,
    ) -> NamedBoxes:
        """Name the boxes, as ``gcs identify`` does: same input, same names.

        Args:
            detector: Finds the vehicles, in place of what was detected: a function from an image (H, W, 3) BGR to
                ``Detections``. Two threads call it. None: as recorded, else the mission's.
            detect: Look at the film again although detections were recorded.
            hindsight: Name boxes by what is known of their track 15 s later (True), or as a screen would have shown
                them (False). None: by hindsight, but a flight that Rollcall recorded as it was seen.
            out: Folder in which ``identity.csv``, ``identity.jsonl`` and ``events.jsonl`` are kept; None: nowhere.

        Raises:
            GcsError, MavlinkError, VisionError: A part of the flight cannot be used, or ``out`` has these files.
        """
        notes: list[str] = []
        used = _Function(detector) if callable(detector) else detector
        with TemporaryDirectory() as scratch:
            folder = Path(scratch if out is None else out)
            identify_session(
                self.session,
                folder,
                detect=detect or used is not None,
                hindsight=hindsight,
                note=notes.append,
                open_detector=None if used is None else lambda choice: used,
            )
            with (folder / IDENTITY_EVIDENCE).open("rb") as lines:
                return NamedBoxes.of_lines(lines, tuple(notes))


def open_flight(
    path: Path | str,
    *,
    video: Path | str | None = None,
    video_start_s: float = 0.0,
    mission: Path | str | None = None,
    frame_size: tuple[int, int] | None = None,
) -> FlightRecording:
    """Open a session folder, or a telemetry log with its film.

    Args:
        path: The folder or the log.
        video: Film, in place of the session's own.
        video_start_s: When a film without frame times begins, seconds after the log's first message.
        mission: Mission file, in place of the session's own; without either the log tells who flew.
        frame_size: Width and height of the frames, px, of a recording without a film that does not know them.

    Raises:
        GcsError, MavlinkError: The flight or the mission cannot be used.
    """
    film, file = (None if given is None else Path(given) for given in (video, mission))
    session = open_session(Path(path), video=film, video_start_s=video_start_s, mission=file, frame_size=frame_size)
    return FlightRecording(session)


def score_boxes(boxes: NamedBoxes | Path | str, truth: Path | str) -> Score:
    """The score of names against the truth.

    Raises:
        GcsError: The two have nothing in common, or a file cannot be used.
    """
    if not isinstance(boxes, NamedBoxes):
        return score_files(Path(truth), Path(boxes))
    return score(match(read_truth(Path(truth)), Table(columns=dict(boxes), skipped=0)))


@dataclass(frozen=True, slots=True)
class _Function:
    """A function in the place of a detector."""

    function: Detect

    def detect(self, image: Image, *, gsd_m: float | None = None) -> Detections:
        """Ask it; it finds its scale itself."""
        return self.function(image)
