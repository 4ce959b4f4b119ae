"""The ways of vehicles and of strangers over the ground, as far as they were seen: what becomes a line on a map.

Units and frames: WGS-84 degrees, Unix µs, 1σ in metres; NaN is unknown.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from itertools import groupby
from typing import Final

from gcs.export.job import ExportJob
from gcs.export.unfinished import Unfinished
from gcs.session.line_file import open_new
from gcs.snapshot import Box, Snapshot
from infra.plain_text import plain

GAP_US: Final = 2_000_000
"""A line over a longer time would show a way that nobody saw, unless frames are as far apart."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def time_utc(t_us: int) -> str:
    """A moment as ISO 8601 has it, to the millisecond: ``2026-11-20T10:33:12.345Z``."""
    moment = _EPOCH + timedelta(milliseconds=t_us // 1000)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.") + f"{moment.microsecond // 1000:03d}Z"


def placed(box: Box) -> bool:
    """Tell whether it is known where a box is on the earth."""
    return math.isfinite(box.lat_deg) and math.isfinite(box.lon_deg)


def _numbers() -> array[float]:
    return array("d")


def _times() -> array[int]:
    return array("q")


@dataclass(frozen=True, slots=True)
class WaySummary:
    """A way in a few numbers."""

    confidence_mean: float
    confidence_min: float
    place_std_m_max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One track under one name, without a gap; all columns are of one length, in order of time."""

    track_id: int
    number: int
    """Number of a stranger, the same for all cameras of a flight."""
    system_id: int
    """0: a stranger."""
    name: str
    """Plain text, empty: a stranger."""
    t_us: array[int] = field(default_factory=_times)
    lon_deg: array[float] = field(default_factory=_numbers)
    lat_deg: array[float] = field(default_factory=_numbers)
    confidence: array[float] = field(default_factory=_numbers)
    place_std_m: array[float] = field(default_factory=_numbers)

    @property
    def owner(self) -> tuple[int, int]:
        """Id that all ways of a vehicle have in common, and all of a stranger."""
        return (self.system_id, 0) if self.system_id else (0, self.number)

    @property
    def title(self) -> str:
        """Name on a map."""
        return self.name if self.system_id else f"unknown {self.number}"

    def summary(self) -> WaySummary:
        """NaN where nothing is known."""
        sure = [value for value in self.confidence if math.isfinite(value)]
        near = [value for value in self.place_std_m if math.isfinite(value)]
        mean = sum(sure) / len(sure) if sure else math.nan
        return WaySummary(mean, min(sure, default=math.nan), max(near, default=math.nan))


class Ways:
    """Collects boxes; 40 bytes each."""

    def __init__(self) -> None:
        self._ways: list[Way] = []
        self._latest: dict[int, Way] = {}
        self._before_us = 0

    def add(self, snapshot: Snapshot) -> None:
        """Continue lines by the boxes seen in a frame."""
        for box in snapshot.new_boxes:
            if box.coasting or not box.track_id or not placed(box):
                continue
            way = self._latest.get(box.track_id)
            if way is None or not self._continues(way, box, snapshot.t_us):
                name = plain(snapshot.name_of(box.system_id)) if box.system_id else ""
                way = self._latest[box.track_id] = Way(
                    track_id=box.track_id, number=box.known_as, system_id=box.system_id, name=name
                )
                self._ways.append(way)
            way.t_us.append(snapshot.t_us)
            way.lon_deg.append(box.lon_deg)
            way.lat_deg.append(box.lat_deg)
            way.confidence.append(box.confidence)
            way.place_std_m.append(box.place_std_m)
        self._before_us = snapshot.t_us

    def _continues(self, way: Way, box: Box, t_us: int) -> bool:
        last_us = way.t_us[-1]
        seen = last_us < t_us and (t_us - last_us <= GAP_US or last_us >= self._before_us)
        # a line over the 180th meridian would go round the world
        same = way.system_id == box.system_id and (box.system_id or way.number == box.known_as)
        return bool(seen and same) and abs(box.lon_deg - way.lon_deg[-1]) < 180.0

    def __iter__(self) -> Iterator[Way]:
        """Iterate over the ways in the order in which they begin."""
        return iter(self._ways)


Owners = list[tuple[str, list[Way]]]
"""All ways of each vehicle with its title, by system id; then those of each stranger."""


def _by_owner(ways: Ways) -> Owners:
    def key(way: Way) -> tuple[bool, int, int]:
        return (not way.system_id, *way.owner)

    groups = (list(group) for _, group in groupby(sorted(ways, key=key), key=key))
    return [(group[0].title, group) for group in groups]


class WaysExport(ABC):
    """A file of all ways, which is written at the end."""

    def __init__(self, job: ExportJob) -> None:
        self._unfinished = Unfinished(job.path)
        self._name = plain(job.name)
        self._ways = Ways()

    def write(self, snapshot: Snapshot) -> None:
        """Continue lines by the boxes seen in a frame."""
        self._ways.add(snapshot)

    def close(self) -> None:
        """Write the file."""
        with open_new(self._unfinished.path) as file:
            file.writelines(self.lines(self._name, _by_owner(self._ways)))
        self._unfinished.finish()

    @abstractmethod
    def lines(self, name: str, owners: Owners) -> Iterator[str]:
        """Yield the lines of the file, by the format."""
