"""Ground tracks of labelled vehicles: boxes through the camera onto the ground, and a smooth path through those."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline

from sim.annotated.tracks import HEIGHTS_M, AnnotatedTracks
from sim.world.motion import Motion
from sim.world.view import CameraView, ray_ground

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LABEL_STD_PX = 1.5
"""How far a label's centre is off, as those drawn by hand and interpolated are."""
UNSTEADINESS = 1.0
"""Spectral density of the acceleration of a car in traffic, m²/s³: it changes its speed by 1 m/s within a second."""
LEAST_FOR_SPLINE = 5
"""Labels that a smoothing spline needs; fewer get a straight line."""
LEAST_SPEED_MPS = 1.0
"""Below this the path does not tell where a vehicle points: its heading is held."""
MOVED_LENGTHS = 2.0
"""A vehicle that came so many car lengths away from where it began has moved."""
CAR_LENGTH_M = 4.5
"""Length of an ordinary car."""
END_SPEED_S = 0.5
"""Before the first and after the last label a vehicle keeps its mean speed of so long."""


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
        return bool(np.median(np.sort(away)[-LEAST_FOR_SPLINE:]) > MOVED_LENGTHS * CAR_LENGTH_M)

    def at(self, t: FloatArray) -> FloatArray:
        """(T, 2) the smooth path at times t (T,); straight on before the first label and after the last."""
        first, last = float(self.t[0]), float(self.t[-1])
        path = _line(self) if len(self.t) < LEAST_FOR_SPLINE else _spline(self)
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
    driving = np.flatnonzero(speed > LEAST_SPEED_MPS)
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
