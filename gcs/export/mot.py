"""MOTChallenge's folders, as TrackEval reads them: the truth where there is one, and two trackers to hold against it.

    gt/rollcall-all/NAME/gt/gt.txt       frame,id,left,top,width,height,1,1,1         id: the vehicle's true system id
    gt/rollcall-all/NAME/seqinfo.ini     gt/seqmaps/rollcall-all.txt
    trackers/rollcall-all/names/data/NAME.txt     frame,id,left,top,width,height,confidence,-1,-1,-1     id: the name's
    trackers/rollcall-all/tracks/data/NAME.txt    the same of all tracks; id: the track's, confidence: of the box

Frames count from 1, in the order in which they are exported; boxes are the upright ones around the oriented. An unknown
confidence is -1. The truth holds our vehicles alone: a name on a stranger is then a false positive, as it has to be,
and so is a stranger's bare track, which ``gcs score`` does not count.

References:
    Dendorfer et al. 2020, arXiv:2003.09003; https://github.com/JonathonLuiten/TrackEval, docs/MOTChallenge-Official.
"""

from __future__ import annotations

import csv
import math
import re
from typing import Final

import numpy as np

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.frame_tables import read_truth
from gcs.session.line_file import open_new
from gcs.session.tables import Table
from gcs.snapshot import Box, Snapshot
from infra.plain_text import to_cell
from vision.detect.boxes import hull

BENCHMARK: Final = "rollcall-all"
"""Benchmark and split, as TrackEval has it."""
TRACKERS: Final = ("names", "tracks")
_BOX: Final = ("cx", "cy", "w", "h", "angle")


class MotExport:
    """Export to MOT Challenge's format, of boxes that were seen; a coasting one is a guess."""

    def __init__(self, job: ExportJob) -> None:
        self._name = re.sub(r"[^A-Za-z0-9_.-]+", "-", job.name).strip(".-")[:64] or "flight"
        self._truth = read_truth(job.truth) if job.truth is not None else None
        if self._truth is not None and self._truth.skipped:
            job.note(f"{self._truth.skipped} rows of the truth could not be used")
        self._note = job.note
        self._unfinished = Unfinished(job.path)
        self._gt = self._unfinished.path / "gt" / BENCHMARK / self._name
        trackers = self._unfinished.path / "trackers" / BENCHMARK
        self._names, self._tracks = (open_new(trackers / one / "data" / f"{self._name}.txt") for one in TRACKERS)
        self._vehicles: dict[int, str] = {}
        self._frames: list[int] = []
        self._times_us: list[int] = []
        self._size = (0, 0)
        self._doubles = 0

    def write(self, snapshot: Snapshot) -> None:
        """Append the boxes seen in a frame; moments without a frame of their own are left out."""
        if snapshot.frame < 0 or (self._frames and snapshot.frame <= self._frames[-1]):
            return
        self._frames.append(snapshot.frame)
        self._times_us.append(snapshot.t_us)
        self._size = (snapshot.width, snapshot.height)
        named, tracked = set[int](), set[int]()
        for box in snapshot.new_boxes:
            if box.coasting:
                continue
            if self._is_new(box.system_id, named):
                self._vehicles.setdefault(box.system_id, snapshot.name_of(box.system_id))
                self._names.write(self._row(box.system_id, box, box.confidence))
            if self._is_new(box.track_id, tracked):
                self._tracks.write(self._row(box.track_id, box, box.score))

    def close(self) -> None:
        """Write what describes the trackers, and the truth of the frames that were exported."""
        self._names.close()
        self._tracks.close()
        span_s = (self._times_us[-1] - self._times_us[0]) * 1e-6 if self._times_us else 0.0
        rate = (len(self._frames) - 1) / span_s if span_s > 0.0 else 1.0
        with open_new(self._gt / "seqinfo.ini", "[Sequence]\n") as file:
            file.write(f"name={self._name}\nimDir=img1\nframeRate={round(rate, 2):g}\nseqLength={len(self._frames)}\n")
            file.write(f"imWidth={self._size[0]}\nimHeight={self._size[1]}\nimExt=.jpg\n")
        with open_new(self._unfinished.path / "gt" / "seqmaps" / f"{BENCHMARK}.txt", "name\n") as file:
            file.write(f"{self._name}\n")
        with open_new(self._unfinished.path / "vehicles.csv") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(("id", "name"))
            rows.writerows((system_id, to_cell(name)) for system_id, name in sorted(self._vehicles.items()))
        if self._truth is not None:
            with open_new(self._gt / "gt" / "gt.txt") as file:
                file.write(_truth_rows(self._truth, self._frames))
        if self._doubles:
            self._note(f"{self._doubles} boxes of a vehicle or track that had one in the same frame were left out")
        self._unfinished.finish()

    def _is_new(self, number: int, seen: set[int]) -> bool:
        """Tell whether an id is one, and of no other box of the frame: TrackEval refuses a file where it is."""
        if number in seen:
            self._doubles += 1
        if not number or number in seen:
            return False
        seen.add(number)
        return True

    def _row(self, number: int, box: Box, confidence: float) -> str:
        upright = _upright((box.cx, box.cy, box.w, box.h, box.angle))
        sure = f"{confidence:.4f}" if math.isfinite(confidence) else "-1"
        return f"{len(self._frames)},{number},{upright},{sure},-1,-1,-1\n"


def _truth_rows(truth: Table, frames: list[int]) -> str:
    """Lines of ``gt.txt`` for these frames (of the film), which are 1, 2, … there."""
    order = np.argsort(truth["frame"], kind="stable")
    at = truth["frame"][order]
    rows = []
    for count, frame in enumerate(frames, 1):
        seen = set[int]()
        for row in order[slice(*np.searchsorted(at, (frame, frame + 1)))]:
            number = int(truth["system_id"][row])
            if number and number not in seen:
                seen.add(number)
                rows.append(f"{count},{number},{_upright([truth[key][row] for key in _BOX])},1,1,1\n")
    return "".join(rows)


def _upright(box: object) -> str:
    left, top, right, bottom = hull(np.asarray(box, dtype=np.float64)).tolist()
    return f"{left:.2f},{top:.2f},{right - left:.2f},{bottom - top:.2f}"
