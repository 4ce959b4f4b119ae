"""The mission's camera: its field of view and how it hangs, each with where that is from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from gcs.errors import ImportFileError
from gcs.importing.film import ImportedFilm
from gcs.importing.vehicle_log import AngleTrack, VehicleLog
from gcs.mission.mission import Camera
from mavlink.estimation.camera_models import CAMERAS, camera_model
from vision.camera.intrinsics import Intrinsics, from_field_of_view, resized
from vision.camera.lens_file import read_lens

_TURNS = math.radians(5.0)
"""A gimbal that turns by more than this in pitch is followed only where its heading is known too."""
_STRAIGHT_DOWN_DEG = -90.0
_SAME_ASPECT = 0.01
_DOWN = "the camera looks straight down; --pitch changes that"
_SEARCHED = "gcs identify searches for it in the film, once three vehicles drive in view for some 5 s"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions:
    """Camera as the user knows it; None: as found."""

    fov_deg: float | None = None
    lens: Path | None = None
    model: str = ""
    pitch_deg: float | None = None
    mount: Literal["stabilized", "fixed", "gimbal"] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenCamera:
    """A camera and where its numbers are from."""

    camera: Camera
    """Camera, without numbers where nothing tells the field of view."""
    optics: str
    """Source of the field of view, in words."""
    direction: str
    assumed: tuple[str, ...] = ()
    looks_known: bool = True
    """True if anything tells which way it looks."""

    @property
    def stated(self) -> Camera | None:
        """Camera of the mission: without field of view and direction nothing, so that the film is searched for
        both."""
        return self.camera if self.looks_known or self.camera.intrinsics is not None else None


def choose_camera(
    film: ImportedFilm, uav: VehicleLog | None, options: CameraOptions
) -> tuple[ChosenCamera, VehicleLog | None]:
    """The camera, and the UAV's log with what the camera's direction needs of it.

    Args:
        uav: its log; None: its telemetry is in the fleet's.

    Raises:
        ImportFileError: a camera of that name is not known.
        CameraError: the lens file cannot be used.
    """
    lens, optics = _intrinsics(film, uav, options)
    known = camera_model(options.model or film.model)
    if uav is not None and film.height > film.width:
        # later ones are told across the picture
        across = 2.0 * np.arctan(film.width / film.height * np.tan(0.5 * uav.view.hfov))
        uav = replace(uav, view=replace(uav.view, hfov=across))
    mount, pitch_deg, direction, assumed, uav = _direction(uav, options)
    looks_known = _DOWN not in assumed or options.mount is not None
    if lens is None:
        if not looks_known:
            direction, assumed = f"not known: {_SEARCHED}", ()
        camera = Camera(mount=mount, pitch_deg=pitch_deg)
        chosen = ChosenCamera(
            camera=camera, optics=optics, direction=direction, assumed=assumed, looks_known=looks_known
        )
        return chosen, uav
    camera = Camera(
        name=known.name if known else "",
        width=lens.width,
        height=lens.height,
        fx=lens.fx,
        fy=lens.fy,
        cx=lens.cx,
        cy=lens.cy,
        distortion=tuple(lens.distortion.tolist()),
        mount=mount,
        pitch_deg=pitch_deg,
    )
    return ChosenCamera(camera=camera, optics=optics, direction=direction, assumed=assumed), uav


def mast_camera(film: ImportedFilm, camera: Camera, options: CameraOptions) -> ChosenCamera:
    """The camera of a mast, with the lens that the user knows where its own file has none.

    Raises:
        ImportFileError: a camera of that name is not known.
        CameraError: the lens file cannot be used.
    """
    lens, optics = camera.intrinsics, "as its file has it"
    if lens is None:
        lens, optics = _intrinsics(film, None, options)
    if lens is not None:
        numbers = {name: getattr(lens, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
        camera = replace(camera, distortion=tuple(lens.distortion.tolist()), **numbers)
    return ChosenCamera(camera=camera, optics=optics, direction=f"{camera.pitch_deg:g}° (as its file has it)")


def _intrinsics(film: ImportedFilm, uav: VehicleLog | None, options: CameraOptions) -> tuple[Intrinsics | None, str]:
    size = film.width, film.height
    if options.lens is not None:
        return _lens_of(options.lens, film), f"lens file {options.lens.name}"
    if options.fov_deg is not None:
        lens, _ = from_field_of_view(*size, math.radians(options.fov_deg), math.nan)
        return lens, f"{options.fov_deg:g}° across the picture, as given"
    if options.model:
        known = camera_model(options.model)
        if known is None:
            raise ImportFileError(
                f"--camera {options.model}: not known; known are {', '.join(CAMERAS)}; else give --fov"
            )
        return _of_longer_side(film, math.radians(known.hfov_deg), f"of {known.name}: {known.source}")
    if uav is not None and len(uav.view):
        return _of_longer_side(film, float(uav.view.hfov[0]), f"by the {uav.view.source}")
    known = camera_model(film.model) if film.model else None
    if known is None or not known.shows_all(*size):
        there = [f"its container says {film.model}"] if film.model else []
        there += [uav.view.source] if uav is not None and uav.view.source else []
        words = f" ({'; '.join(there)})" if there else ""
        return None, f"nothing tells its field of view{words}: {_SEARCHED}; else --fov, --camera or --lens"
    return _of_longer_side(film, math.radians(known.hfov_deg), f"of {known.name}, by the video: {known.source}")


def _lens_of(path: Path, film: ImportedFilm) -> Intrinsics:
    """A lens file for pictures as they are shown, or as they are coded where pixels are not square."""
    lens = read_lens(path)
    coded = lens.width * film.aspect * film.height
    drawn_out = film.aspect != 1.0 and abs(coded / (lens.height * film.width) - 1.0) < _SAME_ASPECT
    return resized(lens, film.width, film.height, drawn_out=drawn_out)


def _of_longer_side(film: ImportedFilm, fov: float, by: str) -> tuple[Intrinsics, str]:
    """Return the lens by the angle across the longer side, as cameras are described: upright ones are turned.

    Args:
        by: what tells the angle.
    """
    upright = film.height > film.width
    lens, _ = from_field_of_view(film.width, film.height, *((math.nan, fov) if upright else (fov, math.nan)))
    return lens, f"{math.degrees(fov):.1f}°{' across the longer side' if upright else ''} {by}"


def _direction(
    uav: VehicleLog | None, options: CameraOptions
) -> tuple[Literal["stabilized", "fixed", "gimbal"], float, str, tuple[str, ...], VehicleLog | None]:
    """Mount, its pitch in degrees, where that is from, what was assumed, and the log."""
    mount, pitch_deg = options.mount, _STRAIGHT_DOWN_DEG if options.pitch_deg is None else options.pitch_deg
    if uav is None:
        words = "as the UAV's gimbal reports in the telemetry"
        return mount or "gimbal", pitch_deg, f"{words}, else {_pitch_words(options, pitch_deg)}", (), uav
    gimbal = uav.gimbal
    if mount in (None, "gimbal") and options.pitch_deg is None and len(gimbal):
        whole = bool(np.isfinite(gimbal.angles).all(axis=1).any())
        if whole and (gimbal.yaw_from == "nose") <= bool(len(uav.attitudes)):
            if len(uav.attitudes):
                return "gimbal", pitch_deg, "gimbal's angles in the log", (), uav
            level = gimbal.angles * np.array([0.0, 0.0, 1.0])
            uav = replace(uav, attitudes=AngleTrack(t_us=gimbal.t_us, angles=level))
            level_words = "the UAV is level and its nose is where the gimbal looks: only the gimbal's angles count"
            return "gimbal", pitch_deg, "gimbal's angles in the log", (level_words,), uav
        pitch = gimbal.angles[:, 1][np.isfinite(gimbal.angles[:, 1])]
        if len(pitch):
            middle_deg = math.degrees(float(np.median(pitch)))
            turned = np.ptp(pitch) > _TURNS
            kept = ("the gimbal keeps its pitch: it turns, but the heading is not known, so it is not followed",)
            words = f"{middle_deg:.1f}°, the gimbal's pitch in the log; its heading is not known"
            return mount or "stabilized", max(-90.0, min(90.0, middle_deg)), words, kept if turned else (), uav
    assumed: tuple[str, ...] = () if options.pitch_deg is not None else (_DOWN,)
    return mount or "stabilized", pitch_deg, _pitch_words(options, pitch_deg), assumed, uav


def _pitch_words(options: CameraOptions, pitch_deg: float) -> str:
    return f"{pitch_deg:g}° ({'assumed' if options.pitch_deg is None else 'as given'})"
