"""A flight's files as a session: read, put on one time line, written, with what was found, assumed and left out."""

from __future__ import annotations

import heapq
import math
import os
import shutil
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.camera_choice import CameraOptions, ChosenCamera, choose_camera, mast_camera
from gcs.importing.checks.row_times import gaps
from gcs.importing.checks.side_by_side import above_fleet, fleet_words, height_words, uav_words
from gcs.importing.clock_choice import MIN_HEIGHT_M, searched_times
from gcs.importing.film import ImportedFilm, open_film
from gcs.importing.film_log import read_film_log
from gcs.importing.ground_vehicles import LAST_ID, GroundVehicles, check_own_log, clock_words, read_ground_vehicles
from gcs.importing.messages import TlogRecord, vehicle_records
from gcs.importing.smoothing import filled_in
from gcs.importing.sources import read_vehicle_logs
from gcs.importing.timeline import FilmTimes, check_overlap, film_length_us, find_timeline, on_film
from gcs.importing.vehicle_log import ImportNotes, PlaceTrack, VehicleLog
from gcs.mission.mast import Mast
from gcs.mission.mission import Clock, MapChoice, Mission, MissionVehicle, View, load_mast
from gcs.session.metadata import PROGRAM, import_rows, mission_table
from gcs.session.session import VIDEO_SUFFIXES
from infra.session_format import FRAMES, LOG, METADATA, VIEW_FOLDER
from sim.session import new_session, write_frames

_MAX_GAPS = 100
_OF_A_FILM = frozenset({"video", "uav", "attitude", "camera", "direction", "clock"})
"""Subjects and roles that each film of a flight has its own of."""
_CLOCKS = {
    "video": "that of the film",
    "frame": "that of the film: its frames are numbered",
    "utc": "Unix time as it stands in the file",
    "own": "one of its own, of which no date is known",
}
_TIME = struct.Struct(">Q")
_OTHER_NAMES = {".m2ts": ".ts", ".mts": ".ts", ".m4v": ".mp4", ".lrf": ".mp4", ".3gp": ".mp4", ".webm": ".mkv"}
"""Suffixes of containers that are the same under another name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceAccount:
    """Account of one imported file."""

    role: str
    """Role of the file, such as ``uav`` or ``ugv 11``."""
    name: str
    clock: str
    """Clock that its times are of, and what shows it, in words."""
    read: tuple[str, ...]
    assumed: tuple[str, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Number of records, by reason."""
    spans: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=lambda: MappingProxyType({}))
    """Spans of the film, from and to second, by whom the source tells of; without gaps."""

    def table(self) -> dict[str, Any]:
        """Table of the account, for session.toml and for programs."""
        notes = {"clock": self.clock, "read": list(self.read), "assumed": list(self.assumed)}
        spans = {whose: [list(span) for span in parts] for whose, parts in self.spans.items()}
        return {"role": self.role, "name": self.name, **notes, "left_out": dict(self.left_out), "spans": spans}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportReport:
    """Account of what was found, assumed and left out."""

    found: tuple[tuple[str, str], ...]
    """Subject and text."""
    assumed: tuple[str, ...]
    sources: tuple[SourceAccount, ...]
    uav_id: int = 0
    ugv_ids: tuple[int, ...] = ()

    def with_view(self, number: int, other: ImportReport) -> ImportReport:
        """Return the report with what was found of a further film, whose fleet is that of the first."""
        own = [(subject, text) for subject, text in other.found if subject in _OF_A_FILM]
        accounts = [replace(each, role=f"{each.role} {number}", spans={}) for each in other.sources]
        return replace(
            self,
            found=(*self.found, *((f"{subject} {number}", text) for subject, text in own)),
            assumed=tuple(dict.fromkeys((*self.assumed, *other.assumed))),
            sources=(*self.sources, *(each for each in accounts if each.role.partition(" ")[0] in _OF_A_FILM)),
        )

    @property
    def left_out(self) -> dict[str, int]:
        """Number of records that were left out, by file and reason."""
        return {f"{each.name}: {reason}": n for each in self.sources for reason, n in each.left_out.items()}

    def table(self) -> dict[str, Any]:
        """Table of the account, for session.toml and for programs."""
        return {
            "found": {subject: text for subject, text in self.found},
            "assumed": list(self.assumed),
            "left_out": self.left_out,
            "sources": [each.table() for each in self.sources],
        }

    def rows(self) -> list[tuple[str, str]]:
        """Account in short."""
        rows = [*self.found, *(("assumed", text) for text in self.assumed)]
        return rows + [("left out", f"{count} of {reason}") for reason, count in self.left_out.items()]

    def explained(self) -> Iterator[tuple[str, str]]:
        """Account file by file."""
        roles = {each.role for each in self.sources}
        for what, text in import_rows(self.table()):
            yield what if what in roles else f"  {what}", text
        assumed = [(each.name, text) for each in self.sources for text in each.assumed]
        notes = roles | {text for _, text in assumed} | {f"{name}: {text}" for name, text in assumed}
        yield from ((subject, text) for subject, text in self.found if subject not in notes)
        yield from (("assumed", text) for text in self.assumed if text not in notes)


def source_accounts(
    film: ImportedFilm, fleet: GroundVehicles, uav: VehicleLog | None, timeline: FilmTimes
) -> tuple[SourceAccount, ...]:
    """Accounts of each file: the film, the UAV's log, those of ground vehicles, and the fleet's."""
    length_s = float(film.elapsed_us[-1]) * 1e-6
    video = SourceAccount(
        role="video",
        name=film.path.name,
        clock=f"its own time stamps, {length_s:.1f} s; begins {_when(timeline.film_us)} UTC by {timeline.clock_source}",
        read=(f"{len(film.elapsed_us)} frames of {_size(film)}",),
        assumed=film.assumed,
        spans={"video": ((0.0, round(length_s, 3)),)},
    )
    accounts = [video]
    if uav is not None:
        accounts.append(_of_log("uav", uav, timeline.uav_shift_us - timeline.film_us))
    for system_id, log in fleet.logs.items():
        accounts.append(_of_log(f"ugv {system_id}", log, -timeline.film_us))
    if fleet.tlog is not None:
        tlog = fleet.tlog
        tracks = {i: track for i, track in tlog.tracks.items() if len(track) and i not in fleet.logs}
        of_each = (f"system {i}: {_against_film(track, -timeline.film_us)}" for i, track in tracks.items())
        notes = ImportNotes(assumed=tlog.assumptions(without=fleet.logs), skipped=tlog.skipped(tracks))
        account = _account("fleet", tlog.tlog.path.name, tlog.clock, tuple(of_each), notes)
        spans = {f"system {i}": _spans(track, -timeline.film_us) for i, track in tracks.items()}
        accounts.append(replace(account, spans=spans))
    return tuple(accounts)


def _of_log(role: str, log: VehicleLog, shift_us: int) -> SourceAccount:
    read = ", ".join(log.notes.found), _against_film(log.places, shift_us)
    account = _account(role, log.source, log.dated or _CLOCKS[log.clock], read, log.notes)
    return replace(account, spans={role: _spans(log.places, shift_us)})


def _account(role: str, name: str, clock: str, read: tuple[str, ...], notes: ImportNotes) -> SourceAccount:
    return SourceAccount(
        role=role, name=name, clock=clock, read=read, assumed=notes.assumed, left_out=dict(notes.skipped)
    )


def _spans(places: PlaceTrack, shift_us: int) -> tuple[tuple[float, float], ...]:
    """Seconds of the film between gaps, of which only the longest count where there are many."""
    behind, steps = gaps(places.t_us), np.diff(places.t_us)
    behind = np.sort(behind[np.argsort(steps[behind])[-_MAX_GAPS:]])
    t_s = np.round((places.t_us + shift_us) * 1e-6, 3)
    return tuple(zip(t_s[np.r_[0, behind + 1]].tolist(), t_s[np.r_[behind, -1]].tolist(), strict=True))


def _size(film: ImportedFilm) -> str:
    return f"{film.width}×{film.height} px" + (f" ({film.shown_as})" if film.shown_as else "")


def _against_film(places: PlaceTrack, shift_us: int) -> str:
    """Positions beside the film's time."""
    t_s = (places.t_us + shift_us) * 1e-6
    if len(t_s) < 2:
        return f"{len(t_s)} positions"
    steps = np.diff(t_s)
    return (
        f"{len(t_s)} positions from {t_s[0]:+.1f} to {t_s[-1]:+.1f} s of the film, every {np.median(steps):.2f} s, the "
        f"longest gap {steps.max():.1f} s"
    )


def _when(t_us: int) -> str:
    return f"{datetime.fromtimestamp(t_us * 1e-6, UTC):%Y-%m-%d %H:%M:%S}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """The files that make the flight, and what is known of it."""

    video: Path
    uav: Path | None = None
    """None: the UAV's telemetry is in the video or in the fleet's log."""
    ugv: tuple[str, ...] = ()
    """``ID=FILE``, or a table with a column of system ids."""
    tlog: Path | None = None
    clock_s: float | None = None
    """Lead of the fleet's clock over the film's, s; None: searched in the film."""
    clock_within_s: float = math.inf
    """Largest offset that is searched, either way."""
    camera: CameraOptions = field(default_factory=CameraOptions)
    """Options of all films."""
    views: tuple[FurtherFilm, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FurtherFilm:
    """A film that another aircraft took of the same flight, or a camera on a mast."""

    video: Path
    uav: Path | None = None
    """Log of its aircraft, None where the film or the fleet's log has it; of one on a mast the TOML file with that."""

    def of(self, options: ImportOptions) -> ImportOptions:
        """The options of an import of this film; its clock is searched for."""
        return replace(options, video=self.video, uav=self.uav, clock_s=None, views=())


def import_flight(out: Path, options: ImportOptions) -> ImportReport:
    """Write a session from a flight's files.

    Raises:
        GcsError, MavlinkError, VisionError, SimError: a file cannot be used, or they do not belong together.
    """
    if out.exists():
        raise ImportFileError(f"{out}: exists already; recordings are never overwritten, give another name")
    fleet = read_ground_vehicles(options.tlog, options.ugv)
    fleet = replace(fleet, contradictions=(*fleet.contradictions, *fleet_words(fleet)))
    filmed = [_import_film(options, fleet)]
    for further in options.views:
        filmed.append(_import_film(further.of(options), fleet, taken=[each.uav_id for each in filmed]))
    first, *others = filmed
    report, mission = first.report, first.mission
    for number, other in enumerate(others, 2):
        report = report.with_view(number, other.report)
    unread = "; ".join(text for each in filmed for text in each.unread)
    unused = (("not read", unread), ("not in the mission", _not_in_mission(fleet, [each.uav_id for each in filmed])))
    report = replace(report, found=(*report.found, *((subject, text) for subject, text in unused if text)))
    ground = replace(mission.map, takeoff_known=all(each.mission.map.takeoff_known for each in filmed))
    try:
        mission = replace(mission, view=tuple(each.view for each in others), map=ground)
    except ValueError as error:
        raise ImportFileError(str(error)) from None
    films_us = [(each.film_us, each.film_us + film_length_us(each.film)) for each in filmed]
    streams = [*fleet.streams(films_us), *(each.records for each in filmed)]
    write_imported(out, [(each.film, each.film_us) for each in filmed], streams, mission, report.table())
    return report


@dataclass(frozen=True, slots=True, kw_only=True)
class _Filmed:
    """A film on the fleet's time line, with its aircraft."""

    film: ImportedFilm
    film_us: int
    """Unix µs of its first frame."""
    uav_id: int
    records: Iterable[TlogRecord]
    """Packets of the aircraft that the fleet's log has not."""
    mission: Mission
    report: ImportReport
    unread: tuple[str, ...]
    """Telemetry in the film that cannot be read."""

    @property
    def view(self) -> View:
        """View of the film as a further camera of the mission."""
        mission = self.mission
        system_id, name = (0, mission.uav.name) if mission.mast else (self.uav_id, "")
        return View(system_id=system_id, name=name, mast=mission.mast, camera=mission.camera, clock=mission.clock)


def _import_film(options: ImportOptions, fleet: GroundVehicles, taken: Collection[int] = ()) -> _Filmed:
    """Put a film on the fleet's time line; taken: system ids of aircraft that filmed others."""
    film = open_film(options.video)
    _suffix(film.path)  # before minutes are spent on its clock
    if options.uav is not None and options.uav.suffix.lower() == ".toml":
        return _import_from_mast(film, options.uav, options, fleet)
    aircraft = [i for i in fleet.aircraft if i not in taken]
    uav, unread = _uav_log(options, coarse=not aircraft)
    swapped: tuple[str, ...] = ()
    if uav is not None:
        check_own_log(uav, fleet.logs)
        uav, swapped = above_fleet(on_film(uav, film), fleet)
        uav = replace(uav, places=filled_in(uav.places))
    uav_id = _uav_id(aircraft, {*fleet.used_ids, *taken}, uav, unread)
    chosen, uav = choose_camera(film, uav, options.camera)
    timeline = find_timeline(film, uav, fleet.span_us, options.clock_s)
    mission = Mission(
        uav=MissionVehicle(system_id=uav_id),
        ugv=tuple(MissionVehicle(system_id=i) for i in sorted(fleet.places)),
        camera=chosen.camera,
        clock=Clock(video_offset_s="auto"),
        map=MapChoice(takeoff_known=uav is None or bool(np.isfinite(uav.places.height_m).any())),
    )
    if options.clock_s is None:
        seen = _uav_records(uav, uav_id, fleet, timeline)
        try:
            timeline = searched_times(film, uav, fleet, mission, seen, timeline, options.clock_within_s)
        except ImportFileError as error:
            alone = ", which is for the first film: import this one by itself" if taken else ""
            doubts = "".join(f" ({words})" for words in (*_uav_doubts(uav, uav_id, fleet), *fleet.contradictions))
            raise ImportFileError(f"{error}{alone}{doubts}") from error
    uav_span = _uav_span(uav, uav_id, fleet, timeline)
    partly = check_overlap(film, timeline, uav_span, fleet.span_us, dict.fromkeys(fleet.assumed), fleet.spans_us)
    report = _report(film, fleet, uav, chosen, timeline, uav_id)
    return _Filmed(
        film=film,
        film_us=timeline.film_us,
        uav_id=uav_id,
        records=() if uav is None else _uav_records(uav, uav_id, fleet, timeline),
        mission=replace(mission, camera=chosen.stated),
        report=replace(report, assumed=(*report.assumed, *swapped, *partly, *_uav_clock(uav, fleet))),
        unread=unread,
    )


def _import_from_mast(film: ImportedFilm, path: Path, options: ImportOptions, fleet: GroundVehicles) -> _Filmed:
    """Put the film of a camera on a mast on the fleet's time line, by the offset of its file or by the film."""
    view = load_mast(path)
    assert view.mast is not None and view.camera is not None
    offset_s, clock_s = view.clock.video_offset_s, options.clock_s
    if clock_s is None and offset_s != "auto":
        clock_s = -float(offset_s)
    chosen = mast_camera(film, view.camera, options.camera)
    timeline = find_timeline(film, None, fleet.span_us, clock_s)
    mission = Mission(
        mast=replace(view.mast, name=view.name or view.mast.name),
        ugv=tuple(MissionVehicle(system_id=i) for i in sorted(fleet.places)),
        camera=chosen.camera,
        clock=Clock(video_offset_s="auto"),
    )
    if clock_s is None:
        standing = replace(mission, mast=_with_altitude(view.mast, fleet))
        timeline = searched_times(film, None, fleet, standing, (), timeline, options.clock_within_s)
    whole = timeline.film_us, timeline.film_us + film_length_us(film)
    partly = check_overlap(
        film, timeline, (path.name, whole), fleet.span_us, dict.fromkeys(fleet.assumed), fleet.spans_us
    )
    report = _report(film, fleet, None, chosen, timeline, mission.uav.system_id)
    stands = f"{path.name}: on a mast at {view.mast.latitude_deg:.5f}, {view.mast.longitude_deg:.5f}"
    found = tuple((what, stands if what == "uav" else text) for what, text in report.found)
    report = replace(report, found=found, assumed=(*report.assumed, *partly))
    return _Filmed(
        film=film,
        film_us=timeline.film_us,
        uav_id=mission.uav.system_id,
        records=(),
        mission=mission,
        report=report,
        unread=(),
    )


def _with_altitude(mast: Mast, fleet: GroundVehicles) -> Mast:
    """The mast with both of its heights, by the fleet's ground."""
    ground_m = 0.0 if np.isnan(fleet.ground_m) else fleet.ground_m
    if mast.height_m is None and mast.altitude_m is not None:
        return replace(mast, height_m=max(mast.altitude_m - ground_m, MIN_HEIGHT_M))
    altitude_m = ground_m + (mast.height_m or 0.0) if mast.altitude_m is None else mast.altitude_m
    return replace(mast, altitude_m=altitude_m)


def _uav_log(options: ImportOptions, *, coarse: bool) -> tuple[VehicleLog | None, tuple[str, ...]]:
    """The UAV's log, None where neither a file nor the video has one, and what of the video cannot be read."""
    if options.uav is None or options.uav == options.video:
        return read_film_log(options.video, coarse=coarse or options.uav is not None)
    return _one_log(options.uav), ()


def _uav_clock(uav: VehicleLog | None, fleet: GroundVehicles) -> list[str]:
    """Return sentences on where the UAV is in the telemetry too, at other times."""
    if uav is None or uav.clock != "utc" or fleet.tlog is None:
        return []
    return [words for i in fleet.aircraft for words in clock_words(uav, fleet.tlog.places(i))]


def _uav_records(
    uav: VehicleLog | None, uav_id: int, fleet: GroundVehicles, timeline: FilmTimes
) -> Iterable[TlogRecord]:
    """Packets of the UAV, by its log or else by the fleet's."""
    if uav is not None:
        return vehicle_records(uav, uav_id, timeline.uav_shift_us, flies=True, home_m=_home_m(uav, fleet))
    assert fleet.tlog is not None
    return fleet.tlog.records_of(uav_id)


def _uav_span(
    uav: VehicleLog | None, uav_id: int, fleet: GroundVehicles, timeline: FilmTimes
) -> tuple[str, tuple[int, int]]:
    """Source that tells where the UAV was, and its first and last position, Unix µs.

    Raises:
        ImportFileError: nothing does.
    """
    places, source = (None, "") if uav is None else (uav.places, uav.source)
    if fleet.tlog is not None and places is None:
        places, source = fleet.tlog.places(uav_id), f"{fleet.tlog.tlog.path.name}, system {uav_id},"
    if places is None or not len(places):
        raise ImportFileError(f"{source or 'nothing'} reports no position of the UAV; give its log with --uav")
    shift_us = timeline.uav_shift_us if uav is not None else 0
    return source, (int(places.t_us[0]) + shift_us, int(places.t_us[-1]) + shift_us)


def _one_log(path: Path) -> VehicleLog:
    logs = read_vehicle_logs(path)
    if len(logs) > 1:
        raise ImportFileError(f"{path}: {len(logs)} vehicles are in it; give the UAV's log alone")
    return logs[0]


def _home_m(uav: VehicleLog, fleet: GroundVehicles) -> float:
    """Altitude of the take-off, for a log without altitudes or heights.

    Raises:
        ImportFileError: nothing tells how high the UAV was.
    """
    if not (np.isfinite(uav.places.alt_m) | np.isfinite(uav.places.height_m)).any():
        why = "".join(f" ({words})" for words in (*uav.notes.assumed, *uav.notes.skipped))
        raise ImportFileError(f"{uav.source}: nothing in it tells how high the UAV was{why}")
    home_m = fleet.ground_m
    if np.isnan(home_m) and not np.isfinite(uav.places.height_m).any():
        raise ImportFileError(
            f"{uav.source}: only the altitude is known, and that of no ground vehicle to compare it with"
        )
    return 0.0 if np.isnan(home_m) else home_m


def _uav_id(aircraft: Sequence[int], used: Collection[int], uav: VehicleLog | None, unread: tuple[str, ...]) -> int:
    """Id of the UAV: its own, else one that nobody uses.

    Args:
        aircraft: that are in the fleet's log and film nothing else.
        used: ids of others.
        uav: its log, if it has one of its own.
        unread: what of the video could not be read.

    Raises:
        ImportFileError: there is no UAV, or no id for it.
    """
    if uav is None:
        if not aircraft:
            there = f" (not read: {'; '.join(unread)})" if unread else ""
            raise ImportFileError(f"nothing tells where the UAV was; give its log with --uav{there}")
        return int(aircraft[0])
    wanted: list[int] = [uav.system_id, *range(1, LAST_ID + 1)]
    free = [system_id for system_id in wanted if system_id and system_id not in used]
    if free:
        return free[0]
    raise ImportFileError("every system id from 1 to 255 is in use; cut the fleet's log by --system")


def _report(
    film: ImportedFilm,
    fleet: GroundVehicles,
    uav: VehicleLog | None,
    chosen: ChosenCamera,
    timeline: FilmTimes,
    uav_id: int,
) -> ImportReport:
    sources = source_accounts(film, fleet, uav, timeline)
    length_s = float(film.elapsed_us[-1]) * 1e-6
    found = [("video", f"{film.path.name}: {', '.join(sources[0].read)}, {length_s:.1f} s")]
    assumed = [*film.assumed, *timeline.assumed, *chosen.assumed]
    if uav is not None:
        found.append(("uav", f"{uav.source} as system {uav_id}: {', '.join(uav.notes.found)}"))
        assumed += [*(f"{uav.source}: {words}" for words in uav.notes.assumed)]
        if not len(uav.attitudes):
            found.append(("attitude", "none: names rest on motion alone and take longer"))
    else:
        found.append(("uav", f"system {uav_id} of the telemetry"))
    assumed += _uav_doubts(uav, uav_id, fleet)
    found += [(f"ugv {i}", f"{log.source}: {', '.join(log.notes.found)}") for i, log in fleet.logs.items()]
    assumed += fleet.assumed
    count = sum(map(len, fleet.places.values()))
    found.append(("ugv", f"{len(fleet.places)} vehicles, {count} positions"))
    found += [("camera", chosen.optics), ("direction", chosen.direction), ("clock", timeline.clock_source)]
    return ImportReport(
        found=tuple(found),
        assumed=tuple(dict.fromkeys(assumed)),
        sources=sources,
        uav_id=uav_id,
        ugv_ids=tuple(sorted(fleet.places)),
    )


def _uav_doubts(uav: VehicleLog | None, uav_id: int, fleet: GroundVehicles) -> Iterator[str]:
    """Return sentences on what the UAV's places and angles say against those of the fleet, or against their unit.

    Raises:
        ImportFileError: it would be deep below its fleet.
    """
    if uav is not None:
        yield from height_words(uav.source, uav.places, fleet)
        yield from uav_words(uav)
    elif fleet.tlog is not None and uav_id in fleet.tlog.tracks:  # else it is on a mast
        yield from height_words(f"system {uav_id}", fleet.tlog.places(uav_id), fleet)


def _not_in_mission(fleet: GroundVehicles, films: Collection[int]) -> str:
    """Vehicles of the telemetry log that neither film nor are named, and why."""
    if fleet.tlog is None:
        return ""
    silent = [i for i in fleet.tlog.ground if i not in fleet.places]
    aircraft = [i for i in fleet.aircraft if i not in films]
    words = [f"system {i}, which reports no position (GLOBAL_POSITION_INT)" for i in silent]
    return "; ".join([*words, *(f"system {i}, another aircraft" for i in aircraft), *fleet.tlog.unnamed])


def write_imported(
    folder: Path,
    films: Sequence[tuple[ImportedFilm, int]],
    streams: Sequence[Iterable[TlogRecord]],
    mission: Mission,
    notes: Mapping[str, Any],
) -> None:
    """Write the folder; the video is linked where the disk can, else copied.

    Args:
        folder: must not exist.
        films: what was filmed and the Unix µs of its first frame, by each camera.
        streams: records, each in order of time.
        notes: where each number came from, for session.toml.

    Raises:
        SessionWriteError: the folder exists or cannot be made.
        ImportFileError: the video's container is none that a session has.
    """
    suffixes = [_suffix(film.path) for film, _ in films]
    text = mission_table(mission, {"format": 1, "program": PROGRAM, "imported": dict(notes)})
    with new_session(folder) as made:
        with (made / LOG).open("xb") as log:
            for t_us, raw in heapq.merge(*streams, key=lambda record: record[0]):
                log.write(_TIME.pack(t_us) + raw)
        for number, ((film, film_us), suffix) in enumerate(zip(films, suffixes, strict=True), 1):
            place = made / VIEW_FOLDER.format(number) if number > 1 else made
            place.mkdir(exist_ok=True)
            write_frames(place / FRAMES.name, film.elapsed_us + film_us)
            _link(film.path, place / f"video{suffix}")
        (made / METADATA).write_text(text, encoding="utf-8")


def _suffix(path: Path) -> str:
    suffix = _OTHER_NAMES.get(path.suffix.lower(), path.suffix.lower())
    if suffix not in VIDEO_SUFFIXES:
        raise ImportFileError(f"{path}: a session's video is one of {', '.join(VIDEO_SUFFIXES)}; remux it")
    return suffix


def _link(source: Path, target: Path) -> None:
    """Link the same file under another name; on another disk copy it."""
    try:
        os.link(source.resolve(), target)
    except OSError:
        shutil.copyfile(source, target)
