"""When a film was taken on the fleet's clock, where the user does not tell: searched in the film itself."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs.errors import ImportFileError
from gcs.fold.detector_factory import open_mission_detector
from gcs.importing.film import ImportedFilm
from gcs.importing.fleet_clock import FilmBoxes, FilmedFleetLogs, FleetClock, film_spans, find_fleet_clock
from gcs.importing.ground_vehicles import GroundVehicles
from gcs.importing.messages import TlogRecord
from gcs.importing.timeline import FilmTimes
from gcs.importing.vehicle_log import VehicleLog
from gcs.mission.mission import DetectorChoice, Mission
from vision.detect.scale_finder import ScaleFinder
from vision.video.prefetch import look_ahead
from vision.video.video import Frame, VideoFile

EVERY_US = 240_000
"""Interval between two frames that are looked at: a vehicle moves by less than its own length."""
_FOCALS = (0.71, 1.07, 0.45, 1.69)
"""Focal lengths in widths of the picture, the likeliest first: 70°, 50°, 96° and 33° across."""


def boxes_of_spans(path: Path, film_us: int, choice: DetectorChoice) -> Iterator[FilmBoxes]:
    """Boxes of the parts of a film that tell its clock, each looked at when it is asked for.

    Args:
        film_us: time of its first frame, Unix µs.
        choice: which network.

    Raises:
        VideoError, ModelError: a file cannot be used.
    """
    detector = open_mission_detector(choice)
    with VideoFile.open(path, start_us=film_us) as video:
        for first_us, last_us in film_spans(video.times_us):
            scale = ScaleFinder(detector)
            times, boxes = [], []

            def gsd_m(frame: Frame, scale: ScaleFinder = scale) -> float | None:
                return scale.gsd_m(frame.image, frame.t_us, None)

            with contextlib.closing(look_ahead(_few(video, first_us, last_us), detector, gsd_m)) as looked:
                for frame, found in looked:
                    times.append(frame.t_us)
                    boxes.append(found.useful(choice.score))
            yield FilmBoxes(t_us=np.array(times, np.int64), boxes=boxes, size=(video.width, video.height))


def _few(video: VideoFile, first_us: int, last_us: int) -> Iterator[Frame]:
    """Frames of a part of the video, some time apart."""
    next_us = first_us
    for frame in video.frames(int(np.searchsorted(video.times_us, first_us))):
        if frame.t_us > last_us:
            return
        if frame.t_us >= next_us:
            next_us = frame.t_us + EVERY_US
            yield frame


def searched_times(
    film: ImportedFilm,
    uav: VehicleLog | None,
    fleet: GroundVehicles,
    mission: Mission,
    records: Iterable[TlogRecord],
    times: FilmTimes,
    within_s: float,
) -> FilmTimes:
    """The film's place on the fleet's clock, by how the fleet fits the picture.

    Args:
        uav: the UAV's log; None: its telemetry is in the fleet's.
        mission: who flies, with which camera.
        records: the UAV's, on the clock that ``times`` has.
        within_s: largest offset either way, seconds.

    Raises:
        ImportFileError: no offset fits, or two do.
        VideoError, ModelError: film or detector cannot be used.
    """
    dated = uav is not None and uav.clock == "utc"
    # what --clock counts from
    start_us = film.created_us if dated and film.created_us else times.film_us
    kept = list(records)
    logs = FilmedFleetLogs(mission=mission, uav=lambda: kept, uav_with_fleet=uav is None or dated, fleet=fleet.places)
    either = bool(dated and film.created_us)
    bounds_s, where = (-within_s, within_s), str(film.path)
    spans = _LookedParts(boxes_of_spans(film.path, start_us, mission.detector))
    *guesses, last = _missions(mission, (film.width, film.height))
    for guess in guesses:
        with contextlib.suppress(ImportFileError):
            logs, found = _found(spans, replace(logs, mission=guess), bounds_s, where, either=either)
            break
    else:
        logs, found = _found(spans, replace(logs, mission=last), bounds_s, where, either=either)
    ahead_us = round(found.ahead_s * 1e6)
    uav_us = times.uav_shift_us + (0 if logs.uav_with_fleet else ahead_us)
    return replace(times, film_us=start_us + ahead_us, uav_shift_us=uav_us, said=f"{times.said}, {found.said}")


def _missions(mission: Mission, size: tuple[int, int]) -> list[Mission]:
    """The mission, and where nothing describes its camera's lens the same with each field of view that one may have.

    An offset is found with a focal length up to a quarter too short or a third too long.
    """
    camera = mission.camera
    if camera is None or camera.intrinsics is not None:
        return [mission]
    width, height = size
    described = (
        replace(
            camera,
            width=width,
            height=height,
            fx=focal * width,
            fy=focal * width,
            cx=width / 2.0,
            cy=height / 2.0,
        )
        for focal in _FOCALS
    )
    return [mission, *(replace(mission, camera=each) for each in described)]


class _LookedParts:
    """Parts of a film, each looked at once, however often they are gone through."""

    def __init__(self, parts: Iterator[FilmBoxes]) -> None:
        self._parts, self._seen = parts, list[FilmBoxes]()

    def __iter__(self) -> Iterator[FilmBoxes]:
        yield from self._seen
        for part in self._parts:
            self._seen.append(part)
            yield part


def _found(
    spans: Iterable[FilmBoxes], logs: FilmedFleetLogs, bounds_s: tuple[float, float], where: str, *, either: bool
) -> tuple[FilmedFleetLogs, FleetClock]:
    """The offset, and the logs with whose clock the UAV's is; either: it may be the film's, by the dates of both.

    Raises:
        ImportFileError: no offset fits, or two do.
    """
    try:
        return logs, find_fleet_clock(spans, logs, bounds_s, where)
    except ImportFileError:
        if not either:
            raise
    logs = replace(logs, uav_with_fleet=False)
    try:
        return logs, find_fleet_clock(spans, logs, bounds_s, where)
    except ImportFileError as error:
        taken = "the UAV's clock was taken to be the fleet's, then the film's"
        raise ImportFileError(f"{error} ({taken})") from error
