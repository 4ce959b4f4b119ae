"""Tracks that are points with times and places, whichever file has them: of one vehicle each."""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.checks.row_times import by_number, numbered, row_times
from gcs.importing.formats.text_file import open_file
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog, whole_places
from infra.plain_text import plain
from infra.xml_text import ElementHandler, XmlRefusedError, read_elements

MAX_POINTS = 1_000_000
_MAX_TRACKS = 255
_MAX_NAME = 200
_COLUMNS = 9
"""Columns of a point: Unix seconds, degrees, metres above sea and take-off, 1σ in metres, m/s north and east, line."""
_NUMBER = re.compile(r"(?<!\d)(\d{1,3})(?!.*\d)", re.ASCII)
_DATES = re.compile(r"\d{5,}|\d{1,4}(?:[-._:/T]\d{1,2}){2,}", re.ASCII)
"""Dates and times in a name: no number of a vehicle."""


@dataclass(slots=True)
class _PointTrack:
    name: str = ""
    columns: array[float] = field(default_factory=lambda: array("d"))


class PointTracks:
    """The tracks of a file as they are read."""

    def __init__(self, path: Path, what: str) -> None:
        self.skipped: Counter[str] = Counter()
        self.assumed: dict[str, None] = {}
        """Assumptions in words, once each."""
        self.line = 0
        """Line of the file that is read, from 1."""
        self._path, self._what = path, what
        self._tracks: list[_PointTrack] = []
        self._open = _PointTrack()
        self._count = 0

    def __len__(self) -> int:
        """Number of points that are kept."""
        return sum(len(track.columns) for track in (*self._tracks, self._open)) // _COLUMNS

    def name(self, text: str) -> None:
        """Take the name of the track that is read."""
        self._open.name = plain(text.strip()[:_MAX_NAME])

    def add(
        self,
        unix_s: float,
        place: tuple[float, float],
        *,
        alt_m: float = math.nan,
        height_m: float = math.nan,
        std_m: float = math.nan,
        v_mps: tuple[float, float] = (math.nan, math.nan),
    ) -> None:
        """Add the next point to the track; one without a time or a place is counted.

        Args:
            unix_s: NaN unknown.
            place: latitude and longitude, degrees.
            alt_m: above sea level.
            height_m: above the take-off.
            std_m: 1σ of the place per axis.

        Raises:
            ImportFileError: there are too many.
        """
        self._count += 1
        if self._count > MAX_POINTS:
            raise ImportFileError(f"{self._path}: more than {MAX_POINTS} points; cut it where the flight ends")
        if not (math.isfinite(unix_s) and unix_s >= 0.0):
            self.skipped["points without a time"] += 1
        elif not whole_places(np.array([place[0]]), np.array([place[1]]))[0]:
            self.skipped["points that are no place"] += 1
        else:
            self._open.columns.extend((unix_s, *place, alt_m, height_m, std_m, *v_mps, self.line))

    def end(self) -> None:
        """End the track that was read: it is whole.

        Raises:
            ImportFileError: there are too many.
        """
        if self._open.columns:
            if len(self._tracks) >= _MAX_TRACKS:
                raise ImportFileError(f"{self._path}: more than {_MAX_TRACKS} tracks")
            self._tracks.append(self._open)
        self._open = _PointTrack()

    def logs(self) -> list[VehicleLog]:
        """The vehicles: system ids are the last number in a track's name, 0 without one.

        Raises:
            ImportFileError: there is no point that can be used, or times are of no clock.
        """
        self.end()
        found = list(self._logs())
        if not found:
            left_out = "".join(f"; {count} {reason}" for reason, count in self.skipped.items())
            raise ImportFileError(f"{self._path}: no point with a place and a time in it{left_out}")
        return found

    def _logs(self) -> Iterator[VehicleLog]:
        for track in self._tracks:
            table = np.array(track.columns).reshape(-1, _COLUMNS)
            source = f"{self._path.name} ({track.name})" if track.name else self._path.name
            lines = table[:, 8].astype(np.int64)
            where = numbered("line", lines) if np.ptp(lines) else by_number
            ordered = row_times(np.rint(table[:, 0] * 1e6).astype(np.int64), table[:, 1:3], source, where)
            table, number = table[ordered.rows], _NUMBER.search(_DATES.sub("", track.name))
            system_id = int(number.group(1)) if number else 0
            std_m = table[:, 5][np.isfinite(table[:, 5])]
            yield VehicleLog(
                source=source,
                clock="utc",
                system_id=system_id if system_id <= 255 else 0,
                places=PlaceTrack.of(
                    ordered.t_us,
                    table[:, 1],
                    table[:, 2],
                    alt_m=table[:, 3],
                    height_m=table[:, 4],
                    v_ned=np.column_stack([table[:, 6:8], np.full(len(table), np.nan)]),
                    std_m=float(np.median(std_m)) if len(std_m) else math.nan,
                ),
                notes=ImportNotes(
                    found=(f"{self._what}, {len(table)} points",),
                    assumed=(*self.assumed, *ordered.assumed),
                    skipped={**self.skipped, **ordered.skipped},
                ),
            )


def read_xml_tracks(
    path: Path,
    kind: str,
    tracks: PointTracks,
    ended: ElementHandler,
    most_text: int,
    end_track: Callable[[], None] = lambda: None,
) -> list[VehicleLog]:
    """Read the vehicles out of XML; a file that ends in the middle has those that are there.

    Args:
        end_track: adds the points that were kept until their track ends.

    Raises:
        ImportFileError: it cannot be read, is not XML, or has no point with a time.
    """
    try:
        with open_file(path) as file:
            broken = read_elements(file, ended, most_text, tracks)
    except XmlRefusedError as error:
        raise ImportFileError(f"{path}: not a {kind} file: {error}") from None
    end_track()
    if broken and not len(tracks):
        raise ImportFileError(f"{path}: not a {kind} file: {broken}")
    tracks.skipped["ends in the middle"] += bool(broken)
    tracks.skipped = +tracks.skipped
    return tracks.logs()
