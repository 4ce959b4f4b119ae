"""A flight's files as a session: read, put on one time line, written, with what was found, assumed and left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.camera_choice import CameraOptions, ChosenCamera, choose_camera
from gcs.importing.film import ImportedFilm, open_film
from gcs.importing.fleet_log import FleetTlog, open_fleet
from gcs.importing.messages import TlogRecord, vehicle_records
from gcs.importing.session_folder import write_imported
from gcs.importing.sources import read_uav
from gcs.importing.timeline import FilmTimes, check_overlap, find_timeline
from gcs.importing.vehicle_log import PlaceTrack, VehicleLog
from gcs.mission.mission import Clock, Mission, MissionVehicle
from mavlink.geodesy import separation_m

__all__ = ["ImportOptions", "ImportReport", "import_flight"]

_LAST_ID = 255
_FAR_M = 100_000.0
"""A UAV that is farther from its fleet than this is not above it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Which files make the flight, and what is known of it."""

    video: Path
    uav: Path | None = None
    """None: the UAV's telemetry is in the video or in the fleet's log."""
    ugv: tuple[str, ...] = ()
    """``ID=FILE``, or a table with a column of system ids."""
    tlog: Path | None = None
    clock_s: float | None = None
    """By how much the fleet's clock is ahead of the film's; None: as the files say."""
    camera: CameraOptions = field(default_factory=CameraOptions)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """What was found, assumed and left out."""

    found: tuple[tuple[str, str], ...]
    """Subject and text."""
    assumed: tuple[str, ...]
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many records, by file and reason."""
    uav_id: int = 0
    ugv_ids: tuple[int, ...] = ()

    def table(self) -> dict[str, Any]:
        """For session.toml and for programs."""
        return {
            "found": {subject: text for subject, text in self.found},
            "assumed": list(self.assumed),
            "left_out": dict(self.left_out),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class _GroundVehicles:
    """The ground vehicles, from whichever files."""

    places: Mapping[int, PlaceTrack]
    """By system id, on Unix time."""
    log: FleetTlog | None

    @property
    def span_us(self) -> tuple[int, int]:
        tracks = [track for track in self.places.values() if len(track)]
        return min(int(track.t_us[0]) for track in tracks), max(int(track.t_us[-1]) for track in tracks)

    @property
    def ground_m(self) -> float:
        """Median altitude, metres above sea level."""
        return float(np.median(np.concatenate([track.alt_m for track in self.places.values()])))

    @property
    def middle(self) -> tuple[float, float]:
        """Median latitude and longitude, degrees."""
        lat = np.concatenate([track.lat_deg for track in self.places.values()])
        lon = np.concatenate([track.lon_deg for track in self.places.values()])
        return float(np.median(lat)), float(np.median(lon))


def import_flight(out: Path, options: ImportOptions) -> ImportReport:
    """Write a session from a flight's files.

    Args:
        out: session folder, which must not exist.
        options: which files, and what is known.

    Raises:
        GcsError, MavlinkError, VisionError, SimError: a file cannot be used, or they do not belong together.
    """
    if out.exists():
        raise ImportFileError(f"{out}: exists already; recordings are never overwritten, give another name")
    film = open_film(options.video)
    fleet = _fleet(options)
    uav, swapped = _above(read_uav(options.uav), fleet, options.uav) if options.uav else (None, ())
    chosen, uav = choose_camera(film, uav, options.camera)
    timeline = find_timeline(film, uav, fleet.span_us, options.clock_s)
    check_overlap(film, timeline, fleet.span_us)
    uav_id = _uav_id(fleet, uav)
    mission = Mission(
        uav=MissionVehicle(system_id=uav_id),
        ugv=tuple(MissionVehicle(system_id=i) for i in sorted(fleet.places)),
        camera=chosen.camera,
        clock=Clock(video_offset_s="auto"),
    )
    report = _report(film, fleet, uav, chosen, timeline, uav_id)
    report = replace(report, assumed=(*report.assumed, *swapped))
    streams: list[Iterable[TlogRecord]] = []
    if fleet.log is not None:
        streams.append(fleet.log.records(without=()))
    if uav is not None:
        home_m = fleet.ground_m
        streams.append(vehicle_records(uav, uav_id, timeline.uav_shift_us, flies=True, home_m=home_m))
    write_imported(out, film, timeline.film_us, streams, mission, report.table())
    return report


def _fleet(options: ImportOptions) -> _GroundVehicles:
    if options.tlog is None:
        raise ImportFileError("no telemetry of the ground vehicles; give --tlog")
    log = open_fleet(options.tlog)
    places = {i: log.places(i) for i in log.ground}
    places = {i: track for i, track in places.items() if len(track)}
    if not places:
        raise ImportFileError(f"{options.tlog}: no ground vehicle reports a position in it")
    return _GroundVehicles(places=places, log=log)


def _above(uav: VehicleLog, fleet: _GroundVehicles, path: Path | None) -> tuple[VehicleLog, tuple[str, ...]]:
    """The log of a UAV that is above its fleet; latitude and longitude are changed over where only that makes it so."""
    lat, lon = float(np.median(uav.places.lat_deg)), float(np.median(uav.places.lon_deg))
    away_m = separation_m(lat, lon, *fleet.middle)
    if away_m < _FAR_M:
        return uav, ()
    if abs(lon) <= 90.0 and separation_m(lon, lat, *fleet.middle) < _FAR_M:
        places = replace(uav.places, lat_deg=uav.places.lon_deg, lon_deg=uav.places.lat_deg)
        return replace(uav, places=places), (f"{uav.source}: latitude and longitude stand the other way round in it",)
    raise ImportFileError(f"{path}: the UAV is {away_m / 1000.0:.0f} km from the fleet; do the files belong together?")


def _uav_id(fleet: _GroundVehicles, uav: VehicleLog | None) -> int:
    """Of the UAV: its own, else one that nobody uses."""
    used: frozenset[int] = fleet.log.system_ids if fleet.log is not None else frozenset()
    if uav is None:
        aircraft = fleet.log.aircraft if fleet.log is not None else ()
        if not aircraft:
            raise ImportFileError("nothing tells where the UAV was; give its log with --uav")
        return int(aircraft[0])
    free = [i for i in (uav.system_id, *range(1, _LAST_ID + 1)) if i and i not in used and i not in fleet.places]
    if not free:
        raise ImportFileError("every system id from 1 to 255 is in use; cut the fleet's log by --system")
    return int(free[0])


def _report(
    film: ImportedFilm,
    fleet: _GroundVehicles,
    uav: VehicleLog | None,
    chosen: ChosenCamera,
    timeline: FilmTimes,
    uav_id: int,
) -> ImportReport:
    length_s = float(film.elapsed_us[-1]) * 1e-6
    found = [
        ("video", f"{film.path.name}: {len(film.elapsed_us)} frames of {film.width}×{film.height} px, {length_s:.1f} s")
    ]
    assumed = [*timeline.assumed, *chosen.assumed]
    left_out: dict[str, int] = {}
    if uav is not None:
        found.append(("uav", f"{uav.source} as system {uav_id}: {', '.join(uav.notes.found)}"))
        assumed += uav.notes.assumed
        left_out |= {f"{uav.source}: {reason}": count for reason, count in uav.notes.skipped.items()}
        assumed += _height_words(uav, fleet)
        if not len(uav.attitudes):
            found.append(("attitude", "none: names rest on motion alone and take longer"))
    else:
        found.append(("uav", f"system {uav_id} of the telemetry"))
    count = sum(map(len, fleet.places.values()))
    found.append(("ugv", f"{len(fleet.places)} vehicles, {count} positions"))
    found += [("camera", chosen.optics), ("direction", chosen.direction), ("clock", timeline.said)]
    return ImportReport(
        found=tuple(found),
        assumed=tuple(assumed),
        left_out=left_out,
        uav_id=uav_id,
        ugv_ids=tuple(sorted(fleet.places)),
    )


def _height_words(uav: VehicleLog, fleet: _GroundVehicles) -> list[str]:
    places = uav.places
    if np.isfinite(places.alt_m).any() and np.isfinite(places.height_m).any():
        return []
    missing = "altitude" if np.isfinite(places.height_m).any() else "height above the ground"
    return [f"the UAV's {missing} by the fleet's median altitude of {fleet.ground_m:.1f} m"]
