"""The image's intrinsics at present: the mission's or those the UAV reports, for this size of image, zoomed.

By order of preference: the mission's numbers or lens file; else CAMERA_FOV_STATUS, VIDEO_STREAM_INFORMATION,
CAMERA_INFORMATION or the known camera that this names, as ``mavlink.estimation.camera_report`` ranks them. Zoom:

- ``zoom`` of the mission magnifies always.
- With ``zoom_max`` of the mission CAMERA_SETTINGS magnifies further: 1 + (zoom_max − 1) · percent / 100, as ArduPilot
  reports it; fields of view that are reported are then those without zoom. Known cameras have a ``zoom_max`` of theirs.
- Without ``zoom_max`` a CAMERA_FOV_STATUS is the field of view now. Where the mission has the numbers they hold for the
  first one received, and later ones magnify by the change: tan(first / 2) / tan(now / 2).
"""

from __future__ import annotations

import math

from gcs.mission.mission import Camera
from gcs.snapshot import Event
from mavlink.state import CameraReport, Level
from vision.camera.intrinsics import Intrinsics, from_field_of_view, resized, zoomed
from vision.errors import CameraError

_SIZELESS = "nothing can be named: the recording does not have the size of its frames; give --frame-size"
REPORTED_ZOOM = 0.03
"""Change of the focal length that is reported."""
REPORT_ZOOM, SETTLED_US = 0.1, 1_500_000
"""Least ln of a zoom found by the image that is reported, and the time for which it must have ended, µs."""


class Optics:
    """The camera's intrinsics over a flight, and what an operator should know of them.

    Args:
        camera: the mission's, None: as the UAV reports it.
        sized: whether an image of unknown size has the size that the camera is described for.
    """

    def __init__(self, camera: Camera | None, *, sized: bool = True) -> None:
        self._camera = camera or Camera()
        self._sized = sized
        self._base = self._camera.intrinsics
        self._size: tuple[int, int] | None = None
        self._first_fov = math.nan
        self._found, self._reported_found, self._found_us, self._known = 1.0, 1.0, 0, math.nan
        """Magnification that nothing reports, the one last announced, the time of its change, and the one that is
        reported."""
        self._reported_source = ""
        self._reported_focal = math.nan
        self._refused = ""
        self._events: list[Event] = []

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the image, px: as seen, else as the mission has it; None while unknown."""
        return self._size or ((self._base.width, self._base.height) if self._base else None)

    def take_events(self) -> list[Event]:
        """News since the last call: the camera used, its zoom, why there is none."""
        events, self._events = self._events, []
        return events

    def intrinsics(self, t_us: int, report: CameraReport | None, size: tuple[int, int] | None) -> Intrinsics | None:
        """Intrinsics of an image.

        Args:
            t_us: its time, for events.
            report: what the UAV reports of its camera, None nothing.
            size: of the image, width and height, px; None: as the last one.

        Returns:
            None while no camera is known, or the one that is cannot have taken the image.
        """
        self._size = size or self._size
        if self._size is None and not self._sized:
            if self._refused != _SIZELESS:
                self._refused = _SIZELESS
                self._add(t_us, "alarm", _SIZELESS)
            return None
        size = self.size or ((report.width, report.height) if report and report.width else None)
        if size is None:
            return None
        if self._base is not None:
            described: Intrinsics | None = self._of_mission(t_us, size)
            source = self._camera.name or "the mission"
        else:
            described, source = _of_report(report, size) if report else (None, "")
        if described is None:
            return None
        zoom = self._zoom(report)
        if not math.isclose(zoom, self._known, rel_tol=REPORTED_ZOOM):
            # a report takes over
            self._found, self._reported_found, self._known = 1.0, 1.0, zoom
        self._tell_found(t_us)
        intrinsics = zoomed(described, zoom * self._found)
        self._report_changes(t_us, intrinsics, source)
        return intrinsics

    def magnify(self, t_us: int, factor: float) -> None:
        """Take in a zoom that the picture shows and nothing reports."""
        self._found, self._found_us = self._found * factor, t_us
        # it is told in other words
        self._reported_focal *= factor

    def _tell_found(self, t_us: int) -> None:
        """Add an event once a zoom that nothing reports has ended."""
        if self._found == self._reported_found or t_us - self._found_us < SETTLED_US:
            return
        if abs(math.log(self._found / self._reported_found)) > REPORT_ZOOM:
            times = self._found / self._reported_found
            self._add(t_us, "warning", f"the camera zoomed {times:.1f} times, which it does not report")
        self._reported_found = self._found

    def _of_mission(self, t_us: int, size: tuple[int, int]) -> Intrinsics | None:
        assert self._base is not None
        try:
            return resized(self._base, *size)
        except CameraError as error:
            if self._refused != str(error):
                self._refused = str(error)
                self._add(t_us, "alarm", f"nothing can be named: {error}")
            return None

    def _zoom(self, report: CameraReport | None) -> float:
        """Magnification of the image against the camera as described."""
        if report is None:
            return self._camera.zoom
        zoom_max = self._camera.zoom_max
        if self._base is None and zoom_max == 1.0:
            zoom_max = report.zoom_max
        if zoom_max > 1.0:
            share = 0.0 if math.isnan(report.zoom_percent) else report.zoom_percent / 100.0
            return self._camera.zoom * (1.0 + (zoom_max - 1.0) * share)
        if self._base is None or report.source != "CAMERA_FOV_STATUS" or math.isnan(report.hfov):
            return self._camera.zoom
        if math.isnan(self._first_fov):
            self._first_fov = report.hfov
        return self._camera.zoom * math.tan(self._first_fov / 2.0) / math.tan(report.hfov / 2.0)

    def _report_changes(self, t_us: int, intrinsics: Intrinsics, source: str) -> None:
        """Add an event when the camera is another, or has zoomed."""
        focal = intrinsics.fx / intrinsics.width
        sees = f"{math.degrees(intrinsics.hfov):.1f}° across {intrinsics.width} px"
        if self._reported_source != source:
            self._reported_source, self._reported_focal = source, focal
            self._add(t_us, "info", f"camera as {source} has it: {sees}")
        elif abs(focal / self._reported_focal - 1.0) > REPORTED_ZOOM:
            self._add(t_us, "info", f"camera zoomed {focal / self._reported_focal:.2f} times: {sees}")
            self._reported_focal = focal

    def _add(self, t_us: int, level: Level, text: str) -> None:
        self._events.append(Event(t_us=t_us, level=level, kind="camera", text=text))


def _of_report(report: CameraReport, size: tuple[int, int]) -> tuple[Intrinsics, str]:
    """The camera that a UAV reports, and in words what that was read from."""
    intrinsics, fits = from_field_of_view(*size, report.hfov, report.vfov)
    source = f"{report.source} ({report.model})" if report.model else report.source
    if not fits and math.isfinite(report.hfov + report.vfov):
        source += f" without its height of {math.degrees(report.vfov):.1f}°, which is another aspect's"
    return intrinsics, source
