"""The ground vehicles of a flight, from all files that have some, on one time line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import metres
from gcs.importing.fleet_log import FleetTlog, open_fleet
from gcs.importing.messages import TlogRecord, vehicle_records
from gcs.importing.sources import read_vehicle_logs
from gcs.importing.timeline import is_about
from gcs.importing.vehicle_log import PlaceTrack, VehicleLog

LAST_ID = 255
_SEARCHES = ((3_000_000, 20_000), (20_000_000, 50_000))
"""Reaches of searches either way and their steps, µs; leap seconds are within the second one."""
_LEAP_US = 18_000_000
_WHERE = ("t_us", "lat_deg", "lon_deg", "alt_m", "height_m")
"""Columns that are the same in two logs of one vehicle."""
_MIN_AHEAD_US = 100_000
_MIN_SHARED, _MAX_SHARED, _MIN_WAY_M = 10, 1000, 5.0
"""Least and most positions that are compared, and the least way of the vehicle: less tells no offset."""
_CLEARLY, _ON_EACH_OTHER_M = 2.0, 1.0
"""An offset counts if with it the paths are this many times closer, and this close: else it is another vehicle's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundVehicles:
    """Ground vehicles of the fleet, from their files."""

    places: Mapping[int, PlaceTrack]
    """Vehicles by system id, on Unix time, each with a position or more."""
    tlog: FleetTlog | None
    """Telemetry log of the ground vehicles, where there is one."""
    logs: Mapping[int, VehicleLog]
    """Logs of the vehicles that are in no telemetry log, by system id."""

    contradictions: tuple[str, ...] = ()
    """Sentences on what one file says against another."""

    @property
    def span_us(self) -> tuple[int, int]:
        """First and last position, Unix µs."""
        first_us, last_us = zip(*self.spans_us.values(), strict=True)
        return min(first_us), max(last_us)

    @property
    def spans_us(self) -> dict[str, tuple[int, int]]:
        """First and last position of each, Unix µs, by what tells of it."""
        tlog = self.tlog.tlog.path.name if self.tlog is not None else ""
        return {
            f"{self.logs[i].source if i in self.logs else tlog}, system {i},": (int(track.t_us[0]), int(track.t_us[-1]))
            for i, track in self.places.items()
        }

    @property
    def ground_m(self) -> float:
        """Median altitude, metres above sea level; NaN unknown."""
        alt = np.concatenate([track.alt_m for track in self.places.values()])
        alt = alt[np.isfinite(alt)]
        return float(np.median(alt)) if len(alt) else float("nan")

    @property
    def assumed(self) -> tuple[str, ...]:
        """Assumptions about them, with the file where there is one for each."""
        of_tlog = self.tlog.assumptions(without=self.logs) if self.tlog is not None else ()
        of_logs = (f"{log.source}: {words}" for log in self.logs.values() for words in log.notes.assumed)
        return (*of_tlog, *of_logs, *self.contradictions)

    @property
    def middle(self) -> tuple[float, float]:
        """Median latitude and longitude, degrees."""
        lat = np.concatenate([track.lat_deg for track in self.places.values()])
        lon = np.concatenate([track.lon_deg for track in self.places.values()])
        return float(np.median(lat)), float(np.median(lon))

    @property
    def used_ids(self) -> frozenset[int]:
        """System ids that somebody has."""
        sending = self.tlog.system_ids if self.tlog is not None else frozenset[int]()
        return sending | frozenset(self.places)

    @property
    def aircraft(self) -> tuple[int, ...]:
        """System ids of the aircraft in the telemetry log."""
        return self.tlog.aircraft if self.tlog is not None else ()

    def streams(self, films_us: Sequence[tuple[int, int]]) -> list[Iterable[TlogRecord]]:
        """Records of the ground vehicles, each stream in order of time, without logs from another time than all films.

        Args:
            films_us: first and last moment of each, Unix µs.
        """
        streams: list[Iterable[TlogRecord]] = []
        if self.tlog is not None:
            streams.append(self.tlog.records(without=self.logs))
        home_m = self.ground_m
        for system_id, log in self.logs.items():
            span_us = int(log.places.t_us[0]), int(log.places.t_us[-1])
            if any(is_about(film_us, span_us) for film_us in films_us):
                streams.append(
                    vehicle_records(log, system_id, 0, flies=False, home_m=0.0 if np.isnan(home_m) else home_m)
                )
        return streams


def read_ground_vehicles(tlog: Path | None, ugv: Sequence[str]) -> GroundVehicles:
    """All ground vehicles.

    Args:
        ugv: ``ID=FILE``, or a file that has the ids.

    Raises:
        ImportFileError, TlogError: a file cannot be used, ids are missing or given twice, or nobody reports a place.
    """
    if tlog is None and not ugv:
        raise ImportFileError("nothing tells where the ground vehicles were; give --tlog or --ugv")
    logs: dict[int, VehicleLog] = {}
    for word in ugv:
        for system_id, log in _numbered(word):
            if system_id in logs:
                raise ImportFileError(f"--ugv {word}: system id {system_id} is given twice")
            if log.clock != "utc":
                raise ImportFileError(
                    f"--ugv {word}: {log.source} does not know the date, so that it cannot be put beside the others"
                )
            check_own_log(log, logs)
            logs[system_id] = log
    fleet = open_fleet(tlog) if tlog is not None else None
    places = {i: fleet.places(i) for i in fleet.ground} if fleet is not None else {}
    places |= {i: log.places for i, log in logs.items()}
    places = {i: track for i, track in places.items() if len(track)}
    if not places:
        others = [] if fleet is None else [*(f"system {i}, which flies" for i in fleet.aircraft), *fleet.unnamed]
        there = f" ({'; '.join(others)})" if others else ""
        raise ImportFileError(f"{tlog}: no ground vehicle reports a position in it{there}")
    tracks = {} if fleet is None else fleet.tracks
    contradictions = tuple(words for i, log in logs.items() if i in tracks for words in clock_words(log, tracks[i]))
    return GroundVehicles(
        places=dict(sorted(places.items())), tlog=fleet, logs=dict(sorted(logs.items())), contradictions=contradictions
    )


def check_own_log(log: VehicleLog, others: Mapping[int, VehicleLog]) -> None:
    """See that a log is not that of another vehicle as well.

    Raises:
        ImportFileError: one has the same positions at the same times.
    """
    for system_id, other in others.items():
        mine, its = log.places, other.places
        if all(np.array_equal(getattr(mine, name), getattr(its, name), equal_nan=True) for name in _WHERE):
            raise ImportFileError(
                f"{log.source}: the same positions at the same times as in {other.source} of system {system_id}; is "
                "one log given for two vehicles?"
            )


def clock_words(log: VehicleLog, telemetry: PlaceTrack) -> tuple[str, ...]:
    """Lead of a log's clock over the telemetry of the same vehicle, in words where it is or grows.

    Both are of one path: the offset is that with which they lie on each other. A longer search needs a longer log.

    Args:
        log: on Unix time.
        telemetry: on the clock of the station.
    """
    for search_us, step_us in _SEARCHES:
        first_us, last_us = int(log.places.t_us[0]) + search_us, int(log.places.t_us[-1]) - search_us
        rows = np.flatnonzero((telemetry.t_us > first_us) & (telemetry.t_us < last_us))
        shared = telemetry.select(rows[:: len(rows) // _MAX_SHARED + 1])
        half = np.arange(len(shared)) < len(shared) // 2
        offsets = np.arange(-search_us, search_us + 1, step_us)
        parts = [
            path_lead(log.places, shared.select(half), offsets),
            path_lead(log.places, shared.select(~half), offsets),
        ]
        if abs(parts[1].ahead_us - parts[0].ahead_us) >= _MIN_AHEAD_US and all(each.known for each in parts):
            first_s, second_s = (each.ahead_us * 1e-6 for each in parts)
            return (
                f"{log.source}: its clock runs otherwise than the telemetry of the same vehicle: it is "
                f"{first_s:+.2f} s ahead in the first half and {second_s:+.2f} s in the second; the log counts",
            )
        whole = path_lead(log.places, shared, offsets)
        if whole.known and abs(whole.ahead_us) < _MIN_AHEAD_US:
            return ()  # farther off a lap would fit as well
        if whole.known:
            leap = abs(abs(whole.ahead_us) - _LEAP_US) < _LEAP_US // 30
            of_gps = "GPS time and UTC are 18 s apart; " if leap else ""
            return (
                f"{log.source}: its clock is {whole.ahead_us * 1e-6:+.2f} s ahead of the telemetry of the same "
                f"vehicle: they are {whole.now_m:.1f} m apart, with that {whole.then_m:.1f} m; {of_gps}the log counts",
            )
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PathLead:
    """Offset with which two paths lie on each other."""

    ahead_us: int = 0
    now_m: float = math.inf
    then_m: float = math.inf

    @property
    def known(self) -> bool:
        """True if the paths are on each other with that offset, and, where it is not 0, with it alone."""
        apart = abs(self.ahead_us) < _MIN_AHEAD_US or self.now_m >= _CLEARLY * self.then_m
        return self.then_m <= _ON_EACH_OTHER_M and apart


def path_lead(path: PlaceTrack, shared: PlaceTrack, offsets: NDArray[np.int64]) -> PathLead:
    """Lead of a path over another one, among some offsets, µs; infinite distances where that one hardly moves."""
    if len(shared) < _MIN_SHARED:
        return PathLead()
    at_m = metres(np.column_stack([np.r_[path.lat_deg, shared.lat_deg], np.r_[path.lon_deg, shared.lon_deg]]))
    path_m, wanted_m = at_m[: len(path)], at_m[len(path) :]
    if np.ptp(wanted_m, axis=0).max() < _MIN_WAY_M:
        return PathLead()

    def apart_m(ahead_us: int) -> float:
        t_us, zero_us = shared.t_us + ahead_us, path.t_us[0]
        found = [np.interp(t_us - zero_us, path.t_us - zero_us, path_m[:, axis]) for axis in (0, 1)]
        return float(np.median(np.hypot(*(np.column_stack(found) - wanted_m).T)))

    best_us = min(offsets.tolist(), key=apart_m)
    return PathLead(ahead_us=best_us, now_m=apart_m(0), then_m=apart_m(best_us))


def _numbered(word: str) -> list[tuple[int, VehicleLog]]:
    """System ids and logs of one ``--ugv``."""
    number, _, name = word.partition("=")
    numbered = number.isascii() and number.isdecimal() and bool(name)
    given_id = int(number) if numbered and len(number) <= 3 else 0
    if given_id > LAST_ID or (numbered and not given_id):
        raise ImportFileError(f"--ugv {word}: a system id is 1 to {LAST_ID}")
    logs = read_vehicle_logs(Path(name if given_id else word))
    if given_id and len(logs) > 1:
        raise ImportFileError(f"--ugv {word}: {len(logs)} vehicles are in it; give it without the id")
    found = [(given_id or log.system_id, log) for log in logs]
    for system_id, log in found:
        if not system_id:
            raise ImportFileError(f"--ugv {word}: {log.source} has no system id; give it as --ugv ID={Path(word).name}")
    return found
