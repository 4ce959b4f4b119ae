"""A world whose vehicles and camera move as in an annotated film.

Vehicles follow smooth paths through their boxes' places on the ground; the camera's path over level ground comes from
how the images of the film map onto each other. Each image's pose is the one under which ground points, placed by the
pose before it, appear where the homography between the two images sends them. In a narrow view a tilt looks like a
shift; what the pixels leave open is decided for a camera that is held level, so that errors add up to a slow drift over
the ground and not to a fall. Ground positions are placed by these same poses: a drift moves vehicles and camera alike
and leaves where they appear as it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline
from scipy.optimize import least_squares

from sim.annotated.camera_guess import GuessedCamera
from sim.annotated.tracks import HEIGHTS_M, AnnotatedTracks
from sim.errors import AnnotationError
from sim.world.actors import Actors, choose_roles
from sim.world.camera import view_from
from sim.world.error_draws import FlightErrors
from sim.world.flight import UavMotion, UavTruth
from sim.world.motion import Motion, time_grid
from sim.world.scenario import Scenario, ScenarioCamera, ScenarioFlight, ScenarioGround
from sim.world.view import CameraView, Scene, project, ray_ground
from sim.world.world import LEAD_S, TAIL_S, World, random_stream

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

GRID = 5
"""Points across and down the image at which two poses are compared."""
PIXEL_STD = 1.0
"""1σ of a place by a homography, px."""
LEVEL_STD = np.radians(2.0)
"""1σ by which a camera that is held level strays from its tilt, rad."""
FARTHEST = 8.0
"""Ground that is this many heights away is too near the horizon to compare poses by."""
MIN_POINTS = 6
"""Points of the ground that two images must share."""
FAR_OFF = 1e4
"""A point that a pose does not show counts as this many px off, and none as more."""
MAX_CLIMB = 1.5
"""Most height that a camera gains or loses from one image to the next, as a factor: a homography that says more is
wrong."""
SPEED_SPAN_S = 1.0
"""Time over which the reported speed of the UAV is taken."""
MAX_TRIES = 60
"""Maximum tries of poses for one image, derivatives included; ten are common."""
LABEL_STD_PX = 1.5
"""1σ of a label's centre, px, as of those drawn by hand and interpolated."""
UNSTEADINESS = 1.0
"""Spectral density of the acceleration of a car in traffic, m²/s³: it changes its speed by 1 m/s within a second."""
MIN_FOR_SPLINE = 5
"""Labels that a smoothing spline needs; fewer get a straight line."""
MIN_SPEED_MPS = 1.0
"""Speed below which the path does not tell where a vehicle points, so its heading is held, m/s."""
MOVED_LENGTHS = 2.0
"""A vehicle that came this many car lengths away from where it began has moved."""
CAR_LENGTH_M = 4.5
"""Length of an ordinary car."""
END_SPEED_S = 0.5
"""Time at the first and last label over which a vehicle's speed before and after them is taken."""


def hovering(scenario: Scenario, t: FloatArray) -> UavMotion:
    """A camera that does not move, at the scenario's height; t (T,) seconds of the images."""
    pose = np.array([0.0, 0.0, scenario.flight.height_m, 0.0, 0.0, 0.0])
    return _motion(t, np.tile(pose, (len(t), 1)))


def follow_camera(scenario: Scenario, t: FloatArray, motions: Sequence[FloatArray | None]) -> UavMotion:
    """The UAV's motion that explains the images.

    Args:
        scenario: its camera, mounted so that it has the film's usual tilt on a level UAV, and the first height.
        t: (T,) seconds of the images.
        motions: T homographies (3, 3) from the image before to this one, px; None where the images do not tell: the
            camera is taken to stand still then. The first is not used.
    """
    uv = _grid(scenario)
    poses = [np.array([0.0, 0.0, scenario.flight.height_m, 0.0, 0.0, 0.0])]
    for H in motions[1:]:
        poses.append(poses[-1] if H is None else _next_pose(scenario, poses[-1], H, uv))
    return _motion(t, np.array(poses))


def _next_pose(scenario: Scenario, before: FloatArray, H: FloatArray, uv: FloatArray) -> FloatArray:
    """Pose (6,) east, north, up, yaw, pitch, roll of the image that H leads to."""
    height = before[2]
    ground = ray_ground(_view(scenario, before), uv)
    near = np.linalg.norm(ground[:, :2] - before[:2], axis=1) < FARTHEST * height
    homogeneous = np.column_stack([uv, np.ones(len(uv))]) @ H.T
    near &= homogeneous[:, 2] > 0.0
    if np.count_nonzero(near) < MIN_POINTS:
        return before
    ground, wanted = ground[near], homogeneous[near, :2] / homogeneous[near, 2:]

    def residuals(pose: FloatArray) -> FloatArray:
        seen, _ = project(_view(scenario, pose), ground)
        off = np.clip(np.nan_to_num((seen - wanted) / PIXEL_STD, nan=FAR_OFF), -FAR_OFF, FAR_OFF)
        return np.concatenate([off.ravel(), pose[4:] / LEVEL_STD])

    scale = [height, height, height, 1.0, 1.0, 1.0]
    found = least_squares(residuals, before, method="lm", x_scale=scale, max_nfev=MAX_TRIES)
    plausible = bool(np.isfinite(found.x).all()) and 1.0 / MAX_CLIMB < found.x[2] / height < MAX_CLIMB
    return np.asarray(found.x) if plausible else before


def _grid(scenario: Scenario) -> FloatArray:
    camera = scenario.camera
    u, v = np.meshgrid(np.linspace(0.05, 0.95, GRID) * camera.width, np.linspace(0.05, 0.95, GRID) * camera.height)
    return np.column_stack([u.ravel(), v.ravel()])


def _view(scenario: Scenario, pose: FloatArray) -> CameraView:
    at = UavTruth(p_enu=pose[:3], v_enu=np.zeros(3), yaw=pose[3], pitch=pose[4], roll=pose[5])
    return view_from(scenario, at)


def _motion(t: FloatArray, poses: FloatArray) -> UavMotion:
    """Poses (T, 6) at times t (T,), held before the first and after the last."""
    t = np.concatenate([[min(-LEAD_S, t[0] - 1.0)], t, [t[-1] + TAIL_S + 1.0]])
    poses = np.concatenate([poses[:1], poses, poses[-1:]])
    poses[:, 3:] = np.unwrap(poses[:, 3:], axis=0)
    ends = [
        np.stack([np.interp(t + s, t, p) for p in poses[:, :3].T], axis=1)
        for s in (-0.5 * SPEED_SPAN_S, 0.5 * SPEED_SPAN_S)
    ]
    v = (ends[1] - ends[0]) / SPEED_SPAN_S
    return UavMotion(t=t, values=np.column_stack([poses[:, :3], v, poses[:, 3:]]), wobble=np.empty((0, 3)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundTrack:
    """One vehicle's k labels on the ground."""

    track: int
    """The vehicle's number in the label file."""
    frames: IntArray
    """(k,) of the film, ascending."""
    t: FloatArray
    """(k,) seconds."""
    xy: FloatArray
    """(k, 2) ENU metres, as the labels have it."""
    std: FloatArray
    """(k,) metres: what a label's error is there."""

    @property
    def moved(self) -> bool:
        """True if it came away from where it began by more than labels err."""
        away = np.linalg.norm(self.xy - self.xy[0], axis=1)
        return bool(np.median(np.sort(away)[-MIN_FOR_SPLINE:]) > MOVED_LENGTHS * CAR_LENGTH_M)

    def at(self, t: FloatArray) -> FloatArray:
        """(T, 2) the smooth path at times t (T,); straight on before the first label and after the last."""
        first, last = float(self.t[0]), float(self.t[-1])
        path = _line(self) if len(self.t) < MIN_FOR_SPLINE else _spline(self)
        inside = np.clip(t, first, last)
        span = min(END_SPEED_S, last - first)
        if span == 0.0:
            return path(inside)
        ends = path(np.array([first, first + span, last - span, last]))
        v = np.where((t < first)[:, None], ends[1] - ends[0], ends[3] - ends[2]) / span
        return np.asarray(path(inside) + v * (t - inside)[:, None])


def ground_tracks(tracks: AnnotatedTracks, t: FloatArray, views: dict[int, CameraView]) -> list[GroundTrack]:
    """Place every label that meets the ground.

    Args:
        tracks: labels.
        t: (T,) seconds of the film's images.
        views: the camera at every image that has labels.

    Returns:
        the vehicles in the order of their numbers.
    """
    xy, std = np.full((len(tracks), 2), np.nan), np.full(len(tracks), np.nan)
    centre = tracks.centre
    middle = np.array([0.5 * HEIGHTS_M[kind] for kind in tracks.kind.tolist()])
    for row, frame in enumerate(tracks.frame.tolist()):
        view = views[frame]
        # the middle of a box is that of the body, half its height above the ground
        hit = ray_ground(view, centre[row], middle[row])[:2]
        xy[row] = hit
        # one pixel is d / f metres across; along the line of sight more, by the angle of depression
        away = float(np.linalg.norm(hit - view.p_enu[:2]))
        slant = np.hypot(away, view.p_enu[2])
        std[row] = LABEL_STD_PX * slant / view.fx * slant / view.p_enu[2]
    known = np.isfinite(xy).all(axis=1)
    found = []
    for number in np.unique(tracks.track[known]).tolist():
        rows = np.flatnonzero(known & (tracks.track == number))
        frames = tracks.frame[rows]
        found.append(GroundTrack(track=number, frames=frames, t=t[frames], xy=xy[rows], std=std[rows]))
    return found


def ground_motion(tracks: list[GroundTrack], grid: FloatArray) -> Motion:
    """The smooth paths on a time grid (T,); the heading of a vehicle that never drives is NaN."""
    xy = np.stack([track.at(grid) for track in tracks], axis=1)
    v = np.gradient(xy, grid, axis=0)
    speed = np.linalg.norm(v, axis=2)
    heading = np.stack([_heading(v[:, i], speed[:, i]) for i in range(len(tracks))], axis=1)
    return Motion(t=grid, xy=xy, heading=heading, speed=speed)


def _heading(v: FloatArray, speed: FloatArray) -> FloatArray:
    """(T,) radians clockwise from north, unwrapped; between times of driving turned evenly."""
    driving = np.flatnonzero(speed > MIN_SPEED_MPS)
    if not len(driving):
        return np.full(len(speed), np.nan)
    turned = np.unwrap(np.arctan2(v[driving, 0], v[driving, 1]))
    return np.asarray(np.interp(np.arange(len(speed)), driving, turned))


def _spline(track: GroundTrack) -> Callable[[FloatArray], FloatArray]:
    # minimise Σ (x_i − f(t_i))² / σ_i² + ∫ f″² / q: the likeliest path of a body with white acceleration of density q
    spline = make_smoothing_spline(track.t, track.xy, w=1.0 / track.std**2, lam=1.0 / UNSTEADINESS)
    return lambda t: np.asarray(spline(t), dtype=np.float64)


def _line(track: GroundTrack) -> Callable[[FloatArray], FloatArray]:
    degree = min(1, len(track.t) - 1)
    first = track.t[0]
    c = np.polynomial.polynomial.polyfit(track.t - first, track.xy, degree, w=1.0 / track.std)
    return lambda t: np.moveaxis(np.polynomial.polynomial.polyval(t - first, c), 0, -1)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmWorld:
    """World that was made of a film."""

    world: World
    """World of the team alone; the others are seen and report nothing."""
    team: tuple[GroundTrack, ...]
    """Tracks of our vehicles, in the order of the world's."""
    labelled: tuple[GroundTrack, ...]
    """Tracks that are labelled and stand on the ground."""

    @property
    def vehicles(self) -> int:
        """Number of bodies that are labelled and stand on the ground."""
        return len(self.labelled)


def film_world(
    tracks: AnnotatedTracks,
    t: FloatArray,
    camera: GuessedCamera,
    size: tuple[int, int],
    motions: Sequence[FloatArray | None] | None,
    errors: FlightErrors,
    *,
    team: int,
    chosen: Sequence[int] = (),
    seed: int = 1,
) -> FilmWorld:
    """Put the film's vehicles on the ground and its camera above them.

    Args:
        tracks: labels.
        t: (T,) seconds of the images, the first at 0.
        size: width and height of the images, px.
        motions: T homographies from the image before, None where unknown; None for a camera that stands still.
        team: how many vehicles are ours: the longest seen of those that move, then of the others.
        chosen: numbers of vehicles in the label file that are ours instead.

    Raises:
        AnnotationError: no such vehicle, or none at all.
    """
    scenario = _scenario(camera, size, t, errors, seed, vehicles=max(1, len(chosen) or team))
    flight = hovering(scenario, t) if motions is None else follow_camera(scenario, t, motions)
    views = {frame: view_from(scenario, flight.at(t[frame])) for frame in np.unique(tracks.frame).tolist()}
    found = ground_tracks(tracks, t, views)
    ours = _chosen(found, chosen) if chosen else _longest_seen(found, team)
    if not ours:
        raise AnnotationError("not one labelled vehicle stands on the ground; is --pitch right?")
    scenario = _scenario(camera, size, t, errors, seed, vehicles=len(ours))
    motion = ground_motion(ours, time_grid(-LEAD_S, scenario.duration_s + TAIL_S))
    actors = Actors(roles=choose_roles(scenario, random_stream(scenario, "cast")), motion=motion, scene=Scene())
    return FilmWorld(world=World(scenario, actors=actors, flight=flight), team=tuple(ours), labelled=tuple(found))


def _scenario(
    camera: GuessedCamera, size: tuple[int, int], t: FloatArray, errors: FlightErrors, seed: int, vehicles: int
) -> Scenario:
    step_s = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    return Scenario(
        name="film",
        seed=seed,
        duration_s=float(t[-1]) + step_s,
        fps=1.0 / step_s,
        ground=ScenarioGround(vehicles=vehicles),
        flight=ScenarioFlight(height_m=camera.height_m),
        camera=ScenarioCamera(
            width=size[0],
            height=size[1],
            fx=camera.focal_px,
            fy=camera.focal_px,
            cx=0.5 * size[0],
            cy=0.5 * size[1],
            # the attitude is the camera's own: what its pixels show of its turns is all that is known
            mount="fixed",
            pitch_deg=camera.pitch_deg,
        ),
        gnss=errors.gnss,
        attitude=errors.attitude,
        timing=errors.timing,
    )


def _longest_seen(tracks: list[GroundTrack], team: int) -> list[GroundTrack]:
    order = sorted(tracks, key=lambda track: (not track.moved, -len(track.frames), track.track))
    return sorted(order[:team], key=lambda track: track.track)


def _chosen(tracks: list[GroundTrack], chosen: Sequence[int]) -> list[GroundTrack]:
    known = {track.track: track for track in tracks}
    missing = [number for number in chosen if number not in known]
    if missing:
        raise AnnotationError(
            f"vehicle {missing[0]} has no label that can be used; there are {', '.join(map(str, sorted(known)[:20]))}"
            + (" …" if len(known) > 20 else "")
        )
    return [known[number] for number in dict.fromkeys(chosen)]
