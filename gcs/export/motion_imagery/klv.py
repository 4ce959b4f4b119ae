"""The film, copied untouched, with where the UAV was and what it saw at every frame: MPEG-TS with KLV (MISB ST 0601).

Without a film it is a stream of KLV alone. Places are the UAV's as it reported them, directions those of the camera as
corrected by what is seen; of the vehicles there is nothing here.
"""

from __future__ import annotations

import math
from collections import deque
from fractions import Fraction

import av
import numpy as np
from av.packet import Packet
from av.stream import Stream
from numpy.typing import NDArray

from gcs.camera_aim import CameraAim
from gcs.errors import GcsError
from gcs.export.film_times import copying, retimed, shown_times
from gcs.export.job import ExportJob
from gcs.export.motion_imagery.misb import klv_set
from gcs.export.unfinished import Unfinished
from gcs.snapshot import Snapshot
from infra.plain_text import plain
from mavlink.geodesy import LocalFrame
from vision.camera.camera import R_ENU_NED, R_GIMBAL_CAM
from vision.video.coded_frames import CodedFilm

TIME_BASE = Fraction(1, 90_000)
CODECS = ("h264", "hevc", "mpeg2video", "mpeg4")
"""Codecs that MPEG-TS carries and other programs expect there."""
MISSION, PLATFORM = 3, 10


class KlvExport:
    """Export to MPEG-TS with KLV: keeps the sets until the end, and copies the film then."""

    def __init__(self, job: ExportJob) -> None:
        self._film = CodedFilm(job.video) if job.video is not None else None
        if self._film is not None and self._film.stream.codec_context.name not in CODECS:
            codec = self._film.stream.codec_context.name
            self._film.close()
            raise GcsError(f"{job.video}: MPEG-TS carries no {codec}; export .mp4 first, or code the film as H.264")
        if self._film is not None and self._film.turned:
            self._film.close()
            raise GcsError(f"{job.video}: MPEG-TS cannot turn pictures as this film asks; export .mp4 first")
        self._mission = plain(job.name)
        self._times_us = job.times_us
        self._sets: list[tuple[int, bytes]] = []
        self._placed = False
        self._note = job.note
        self._unfinished = Unfinished(job.path)

    def write(self, snapshot: Snapshot) -> None:
        """Take what a frame tells of the UAV."""
        if not 0 <= snapshot.frame < len(self._times_us):
            return
        uav = next((row for row in snapshot.vehicles if row.role == "uav"), None)
        texts = {MISSION: self._mission, PLATFORM: plain(uav.name) if uav else ""}
        sight = sight_of(snapshot)
        self._placed |= bool(sight)
        self._sets.append((snapshot.frame, klv_set(snapshot.t_us, sight, texts)))

    def close(self) -> None:
        """Write the file."""
        shown, damaged = shown_times(self._times_us, TIME_BASE), 0
        film = self._film.path if self._film else None
        with copying(film, "MPEG-TS"), av.open(str(self._unfinished.path), "w", format="mpegts") as copy:
            video = copy.add_stream_from_template(self._film.stream) if self._film else None
            data = copy.add_data_stream("klv")
            sets = deque((int(shown[frame]), raw) for frame, raw in self._sets)
            if self._film is not None and video is not None:
                with self._film:
                    for packet in retimed(self._film, shown, TIME_BASE):
                        while sets and sets[0][0] <= (packet.pts or 0):
                            copy.mux(_packet(*sets.popleft(), data))
                        packet.stream = video
                        try:
                            copy.mux(packet)
                        except av.error.InvalidDataError:
                            damaged += 1
            for each in sets:
                copy.mux(_packet(*each, data))
        self._unfinished.finish()
        if damaged:
            self._note(f"{damaged} frames of the film are damaged and were left out")
        if not self._placed:
            self._note("no frame tells where the UAV was, nor does an identity.csv: the sets tell the time alone")


def sight_of(snapshot: Snapshot) -> dict[int, float]:
    """Values of ST 0601 for a frame, by tag: platform, sensor, and the picture on the ground; NaN unknown."""
    values: dict[int, float] = {}
    origin = snapshot.origin
    if origin is None or not np.isfinite(snapshot.uav_enu).all():
        return values
    values |= dict(zip((13, 14, 15), _place(origin, snapshot.uav_enu), strict=True))
    values[5] = math.degrees(snapshot.uav_heading) % 360.0
    view = snapshot.camera
    if view is None or snapshot.pose != "known":
        return values
    values |= _directions(view)
    corners = snapshot.footprint_enu
    if corners is not None and np.isfinite(corners).all():
        ground = np.column_stack([corners, np.full(4, view.ground_z)])
        centre = np.append(_crossing(corners), view.ground_z)
        lat, lon, up = _place(origin, centre)
        values |= {21: float(np.linalg.norm(centre - snapshot.uav_enu)), 23: lat, 24: lon, 25: up}
        for k, corner in enumerate(ground):
            values[82 + 2 * k], values[83 + 2 * k], _ = _place(origin, corner)
    return values


def _directions(view: CameraAim) -> dict[int, float]:
    fields = {16: math.degrees(view.hfov), 17: math.degrees(view.vfov)}
    if not np.isfinite(view.R_enu_body).all():
        return fields
    # R_ned_gimbal = R_ned_body R(azimuth, elevation, roll)
    R_ned_body = R_ENU_NED.T @ view.R_enu_body
    R_body_gimbal = view.R_enu_body.T @ view.R_enu_cam @ R_GIMBAL_CAM.T
    body, sensor = _euler_deg(R_ned_body), _euler_deg(R_body_gimbal)
    platform = {5: body[2] % 360.0, 6: body[1], 7: body[0], 90: body[1], 91: body[0]}
    return fields | platform | {18: sensor[2] % 360.0, 19: sensor[1], 20: sensor[0] % 360.0}


def _euler_deg(R: NDArray[np.float64]) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation; roll 0 where only its difference to the yaw is defined."""
    pitch = -math.degrees(math.asin(max(-1.0, min(1.0, float(R[2, 0])))))
    if abs(R[2, 0]) > 1.0 - 1e-9:
        return 0.0, pitch, math.degrees(math.atan2(-float(R[0, 1]), float(R[1, 1])))
    roll, yaw = math.atan2(float(R[2, 1]), float(R[2, 2])), math.atan2(float(R[1, 0]), float(R[0, 0]))
    return math.degrees(roll), pitch, math.degrees(yaw)


def _crossing(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) where the diagonals of (4, 2) corners cross: there lies the picture's centre, seen from anywhere."""
    # a + s (c − a) = b + t (d − b)
    a, b, c, d = corners
    s, _ = np.linalg.lstsq(np.column_stack([c - a, b - d]), b - a, rcond=None)[0]
    return np.asarray(a + s * (c - a))


def _place(origin: LocalFrame, p_enu: NDArray[np.float64]) -> tuple[float, float, float]:
    lat, lon, alt = origin.to_geodetic(p_enu)
    return float(lat), float(lon), float(alt)


def _packet(at: int, raw: bytes, stream: Stream) -> Packet[Stream]:
    packet = Packet(raw)
    packet.stream, packet.time_base = stream, TIME_BASE
    packet.pts = packet.dts = at
    return packet
