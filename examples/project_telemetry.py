"""Telemetry projected onto a frame: a cross where each vehicle reports to be.

python examples/project_telemetry.py sitl_logs/curved-road 60 crosses.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2

from gcs.fold.camera.direction import mount_of
from gcs.playback.analysis import Analysis
from gcs.session.log import SessionLog
from gcs.session.session import open_session
from mavlink.fleet.fleet import Fleet
from vision.camera.camera import camera_pose, project

YELLOW, CROSS_PX = (0, 255, 255), 24


def main(folder: str, index: int, out: str) -> None:
    session = open_session(Path(folder))
    analysis = Analysis(session)
    mission, video = analysis.mission, analysis.video
    assert mission.camera is not None and mission.camera.intrinsics is not None and video is not None
    frame = video.read(index)
    fleet = Fleet(mission.uav.system_id, mission.ugv_ids)
    for packet in SessionLog(session.tlog).packets():
        if packet.t_us > frame.t_us:
            break
        fleet.add_packet(packet)
    state = fleet.at(frame.t_us)  # all vehicles at the time of the frame, ENU metres
    pose = camera_pose(mount_of(mission.camera), state.uav.p_enu, state.uav.R_enu_body, state.uav.R_enu_gimbal)
    places = state.p_enu.copy()
    places[:, 2] = state.uav.p_enu[2] - state.uav.height_m  # on the ground
    pixels, in_front = project(mission.camera.intrinsics, pose, places)
    height, width = frame.image.shape[:2]
    inside = in_front & (pixels >= 0).all(axis=1) & (pixels < (width, height)).all(axis=1)
    image = frame.image.copy()
    for system_id, (x, y), seen in zip(state.system_id.tolist(), pixels, inside, strict=True):
        if seen:
            cv2.drawMarker(image, (round(x), round(y)), YELLOW, cv2.MARKER_CROSS, CROSS_PX, 2)
            cv2.putText(
                image,
                mission.name_of(system_id),
                (round(x) + 8, round(y) - 8),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.7,
                YELLOW,
                2,
            )
    cv2.imwrite(out, image)
    print(f"{out}: {int(inside.sum())} vehicles on frame {index}")
    analysis.close()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
