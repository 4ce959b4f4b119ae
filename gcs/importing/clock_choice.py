"""The time of a film on the fleet's clock, where the user does not tell: searched in the film itself.

In: boxes of some minutes of the film, the UAV's records, the fleet's positions, each on the clock of its own files. The
search itself is :mod:`assoc.clock_search`; here its inputs are made with the tracker, the fleet and the camera that
identification uses, and its verdict is put into words.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from assoc.clock_search.fine import OffsetFit
from assoc.clock_search.inputs import CameraPath, FleetLog, film_tracks
from assoc.clock_search.search import ClockSearch, ClockVerdict, find_clock
from assoc.history import TrackHistory
from assoc.records import Observation
from gcs.errors import ImportFileError
from gcs.fold.camera.frame_camera import FrameCamera
from gcs.fold.camera.frame_cameras import FrameCameras
from gcs.fold.detector_factory import open_mission_detector
from gcs.fold.evidence import observation_of
from gcs.importing.film import ImportedFilm
from gcs.importing.ground_vehicles import GroundVehicles
from gcs.importing.messages import TlogRecord
from gcs.importing.timeline import FilmTimes
from gcs.importing.vehicle_log import PlaceTrack, VehicleLog
from gcs.mission.mission import DetectorChoice, Mission
from mavlink.fleet.fleet import Fleet
from mavlink.geodesy import LocalFrame
from mavlink.protocol.packet import Packet
from vision.camera.intrinsics import Intrinsics
from vision.detect.detections import Detections
from vision.detect.scale_finder import ScaleFinder
from vision.track.tracker import Tracker
from vision.track.tracks import TrackerParams
from vision.video.prefetch import look_ahead
from vision.video.video import Frame, VideoFile

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

SPAN_US = 60_000_000
"""Span of the film that is looked at at once: a minute tells an offset within hours, more costs more."""
MAX_SPANS = 3
POSE_US = 200_000
"""Interval between two poses of the camera."""
LATE_US = 400_000
"""Delay with which reports may come; a pose is taken once those after it are there."""
ABOUT_US = 30_000_000
"""Margin before and after the film within which the UAV's records are followed, if their place in it is known."""
HEIGHTS_DIFFER_M = 6.0
"""Difference of the ground by take-off and by the fleet's altitudes from which on both are tried, m."""
HEIGHT_STD_M = 2.0
MIN_HEIGHT_M = 3.0
"""Least height from which a UAV films, m."""
HEIGHTS_M, HEIGHTS_SHARE = (12.0, 18.0, 27.0, 40.0, 60.0, 90.0, 130.0), 0.2
"""Heights of a UAV above the ground that are tried where nothing but altitudes tells it, and 1σ as a share."""
LONGEST_TEXT_S = 1e7
"""Offset from which on no bounds are written, s: the user gave none."""
EVERY_US = 240_000
"""Interval between two frames that are looked at: a vehicle moves by less than its own length."""
_FOCALS = (0.71, 1.07, 0.45, 1.69)
"""Focal lengths in widths of the picture, the likeliest first: 70°, 50°, 96° and 33° across."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilmBoxes:
    """Boxes that were seen in some frames of a film."""

    t_us: Ints
    """(F,) on the clock of the film's files, increasing."""
    boxes: Sequence[Detections]
    """F of them."""
    size: tuple[int, int]
    """Width and height of a frame, px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmedFleetLogs:
    """A flight whose clocks may differ."""

    mission: Mission
    uav: Callable[[], Iterable[TlogRecord]]
    """The UAV's records, in order of time, each time it is called."""
    uav_with_fleet: bool
    """The UAV's records are on the fleet's clock; else on the film's."""
    fleet: Mapping[int, PlaceTrack]
    """Positions by system id, on the fleet's clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetClock:
    """The offset of the fleet's clock."""

    ahead_s: float
    """Lead of this clock over the film's, s."""
    std_s: float
    """1σ."""
    evidence: float
    """ln ratio that the film shows this fleet at that offset, to that it shows something else, nats."""
    runner_up_s: float
    """Second best offset, s, NaN none."""
    runner_up_evidence: float
    """Evidence of the second best offset, nats, NaN none."""

    @property
    def clock_source(self) -> str:
        """Words on how the offset was found."""
        text = f"{self.ahead_s:+.2f} s, found by how the fleet fits the film, evidence {self.evidence:.0f}"
        if not np.isfinite(self.runner_up_s):
            return text
        return f"{text}; next best {self.runner_up_s:+.2f} s, {max(self.runner_up_evidence, 0.0):.0f}"


def film_spans(times_us: Ints) -> list[tuple[int, int]]:
    """First and last time of the parts of a film that are looked at, one after the other until one tells the offset.

    Args:
        times_us: (n,) of its frames, increasing.
    """
    first, last = int(times_us[0]), int(times_us[-1])
    if last - first <= 1.5 * SPAN_US:
        return [(first, last)]
    middles = [first + round(share * (last - first)) for share in (0.5, 0.25, 0.75)]
    starts = [int(np.clip(middle - SPAN_US // 2, first, last - SPAN_US)) for middle in middles[:MAX_SPANS]]
    return [(start, start + SPAN_US) for start in starts]


def find_fleet_clock(
    spans: Iterable[FilmBoxes], logs: FilmedFleetLogs, bounds_s: tuple[float, float], where: str = "the film"
) -> FleetClock:
    """Find by how much the fleet's clock is ahead of the film's.

    Args:
        spans: parts of the film; the first that tells the offset decides.
        bounds_s: least and largest offset.

    Raises:
        ImportFileError: two offsets are nearly as good, none fits, or nothing can be compared.
    """
    refused: ClockSearch | None = None
    for boxes in spans:
        found = max(_searches(boxes, logs, bounds_s), key=_evidence, default=None)
        if found is None:
            continue
        if found.verdict is ClockVerdict.FOUND and found.best is not None:
            return _clock_of(found.best, found.runner_up)
        if refused is None or _evidence(found) > _evidence(refused):
            refused = found
    raise ImportFileError(f"{where}: {_reason(refused, bounds_s)}")


def _evidence(found: ClockSearch) -> float:
    return found.best.evidence if found.best is not None else -np.inf


def _clock_of(best: OffsetFit, runner_up: OffsetFit | None) -> FleetClock:
    return FleetClock(
        ahead_s=best.offset_s,
        std_s=best.std_s,
        evidence=best.evidence,
        runner_up_s=runner_up.offset_s if runner_up else float("nan"),
        runner_up_evidence=runner_up.evidence if runner_up else float("nan"),
    )


def _reason(found: ClockSearch | None, bounds_s: tuple[float, float]) -> str:
    """Return why there is no offset, and what to do."""
    low, high = bounds_s
    within = "" if max(-low, high) > LONGEST_TEXT_S else f" between {low:+g} and {high:+g} s"
    if found is None or found.best is None:
        return (
            f"by how much the fleet's clock is ahead of the film's cannot be found{within}: no vehicle was seen for "
            "long enough while the fleet reports; give --clock=+SECONDS"
        )
    best, other = found.best, found.runner_up
    if found.verdict is ClockVerdict.AMBIGUOUS and other is not None:
        one, two = f"{best.offset_s:+.1f}", f"{other.offset_s:+.1f}"
        return (
            f"the fleet fits the film as well with its clock {one} s ahead of the film's as with {two} s: "
            f"give --clock={one} or --clock={two}"
        )
    return (
        f"the fleet does not fit the film at any offset of its clock{within}, {best.offset_s:+.1f} s comes nearest: do "
        "the files belong together, are field of view and --pitch right? Else give --clock=+SECONDS"
    )


def _searches(boxes: FilmBoxes, logs: FilmedFleetLogs, bounds_s: tuple[float, float]) -> Iterator[ClockSearch]:
    """The search in one part of the film, for each height of the ground that is likely."""
    if not len(boxes.t_us):
        return
    start_us = int(boxes.t_us[0])
    views, frame = _views(boxes, logs)
    if not views or frame is None:
        return
    lens = views[0][1].intrinsics
    tracks = _tracks(boxes, lens)
    fleet, fleet_z = _fleet_log(logs.fleet, frame, start_us)
    home_z = float(np.median([view.ground_z for _, view in views]))
    highest = max(float(view.pose.p_enu[2]) for _, view in views)
    grounds = [(home_z, HEIGHT_STD_M)]
    if not logs.mission.map.takeoff_known:
        grounds = [(highest - above_m, HEIGHTS_SHARE * above_m) for above_m in HEIGHTS_M]
    elif np.isfinite(fleet_z) and abs(fleet_z - home_z) > HEIGHTS_DIFFER_M:
        grounds.append((fleet_z, HEIGHT_STD_M))
    for ground_z, std_m in grounds:
        if highest - ground_z > MIN_HEIGHT_M:
            path = _path(views, start_us, ground_z, std_m, lens)
            yield find_clock(tracks, path, fleet, bounds_s, camera_too=logs.uav_with_fleet)


def _tracks(boxes: FilmBoxes, lens: Intrinsics) -> TrackHistory:
    """The film's tracks as rays."""
    tracker, start_us = Tracker(TrackerParams(frame_size=boxes.size)), int(boxes.t_us[0])

    def frames() -> Iterator[tuple[float, Observation]]:
        for t_us, found in zip(boxes.t_us.tolist(), boxes.boxes, strict=True):
            yield (t_us - start_us) * 1e-6, observation_of(t_us, found, tracker.update(found, t_us), lens)

    return film_tracks(frames(), float(boxes.t_us[-1] - start_us) * 1e-6)


def _views(boxes: FilmBoxes, logs: FilmedFleetLogs) -> tuple[list[tuple[int, FrameCamera]], LocalFrame | None]:
    """The camera as the UAV reports it, with the time of each pose, and the frame in which its places are given."""
    mission = logs.mission
    cameras = FrameCameras(mission)
    if mission.mast:
        stands = Fleet(mission.uav.system_id, (), stand=mission.mast.stand)
        about = boxes.t_us[0] - ABOUT_US, boxes.t_us[-1] + ABOUT_US
        places = (
            (t_us, cameras.at(stands.at(t_us), boxes.size)[0]) for t_us in np.linspace(*about, 9).astype(int).tolist()
        )
        return [(t_us, view) for t_us, view in places if view is not None], stands.origin
    fleet = Fleet(mission.uav.system_id, ())
    found: list[tuple[int, FrameCamera]] = []
    first, last = -(1 << 62), 1 << 62
    if not logs.uav_with_fleet:
        first, last = int(boxes.t_us[0]) - ABOUT_US, int(boxes.t_us[-1]) + ABOUT_US
    next_us: int | None = None
    frame: LocalFrame | None = None
    for t_us, raw in logs.uav():
        if not first <= t_us <= last:
            continue
        fleet.add_packet(Packet(t_us, raw))
        if fleet.origin is not frame:
            # places before were in another frame
            found, frame = [], fleet.origin
        next_us = t_us if next_us is None else next_us
        while next_us < t_us - LATE_US:
            state = fleet.at(next_us)
            view, _ = cameras.at(state, boxes.size)
            if view is not None:
                found.append((next_us, view))
            next_us = max(next_us + POSE_US, t_us - 2 * LATE_US)
    return found, frame


def _path(
    views: list[tuple[int, FrameCamera]], start_us: int, ground_z: float, height_std_m: float, lens: Intrinsics
) -> CameraPath:
    """The camera's path on the film's seconds."""
    known = [view.attitude_known for _, view in views]
    return CameraPath(
        t=np.array([(t_us - start_us) * 1e-6 for t_us, _ in views]),
        R_enu_cam=np.stack([view.pose.R_enu_cam for _, view in views]),
        p_enu=np.stack([view.pose.p_enu for _, view in views]),
        ground_z=ground_z,
        px_rad=1.0 / lens.fx,
        heading_known=sum(known) * 2 > len(known),
        half_view=(0.5 * lens.width / lens.fx, 0.5 * lens.height / lens.fy),
        height_std_m=height_std_m,
    )


def _fleet_log(fleet: Mapping[int, PlaceTrack], frame: LocalFrame, start_us: int) -> tuple[FleetLog, float]:
    """The fleet's places on the film's seconds, and the height of its ground, NaN unknown."""
    t, vehicle, p = [], [], []
    for k, system_id in enumerate(sorted(fleet)):
        places = fleet[system_id]
        alt = np.where(np.isfinite(places.alt_m), places.alt_m, frame.alt_m)
        enu = frame.to_enu(places.lat_deg, places.lon_deg, alt)
        enu[~np.isfinite(places.alt_m), 2] = np.nan
        good = np.isfinite(enu[:, :2]).all(axis=1)
        t.append((places.t_us[good] - start_us) * 1e-6)
        vehicle.append(np.full(int(np.count_nonzero(good)), k, np.int64))
        p.append(enu[good])
    at = np.concatenate(p) if p else np.empty((0, 3))
    heights = at[np.isfinite(at[:, 2]), 2]
    log = FleetLog(
        n=len(fleet),
        t=np.concatenate(t) if t else np.empty(0),
        vehicle=np.concatenate(vehicle) if vehicle else np.empty(0, np.int64),
        p_enu=at[:, :2],
    )
    return log, float(np.median(heights)) if len(heights) else float("nan")


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
    kept, with_fleet = list(records), dated or (uav is None and not mission.mast)
    logs = FilmedFleetLogs(mission=mission, uav=lambda: kept, uav_with_fleet=with_fleet, fleet=fleet.places)
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
    return replace(
        times,
        film_us=start_us + ahead_us,
        uav_shift_us=uav_us,
        clock_source=f"{times.clock_source}, {found.clock_source}",
    )


def _missions(mission: Mission, size: tuple[int, int]) -> list[Mission]:
    """The mission; where nothing describes its camera's lens, also with each field of view that one may have.

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
