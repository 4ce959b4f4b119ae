"""Names for the boxes of your own detector: any function from an image to boxes takes the bundled network's place.

python examples/own_detector.py sitl_logs/curved-road
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.fold.pipeline import Pipeline
from gcs.playback.analysis import Analysis
from gcs.session.log import SessionLog
from gcs.session.session import open_session
from vision.detect.detections import Detections

GROUND_PX, CONTRAST, SMALLEST_PX = 101, 40, 200.0


def detect(image: NDArray[np.uint8]) -> Detections:
    """What differs in brightness from the ground, as oriented boxes (pixels, radians). Put your network here."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    small = cv2.medianBlur(cv2.resize(grey, None, fx=0.25, fy=0.25), GROUND_PX // 4)
    ground = cv2.resize(small, (grey.shape[1], grey.shape[0]))
    _, mask = cv2.threshold(cv2.absdiff(grey, ground), CONTRAST, 255, cv2.THRESH_BINARY)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    rows = [cv2.minAreaRect(outline) for outline in outlines if cv2.contourArea(outline) > SMALLEST_PX]
    table = np.array([(*centre, *size, np.deg2rad(turn)) for centre, size, turn in rows]).reshape(-1, 5).T
    cx, cy, w, h, angle = table
    unknown = np.full(len(rows), np.nan)
    return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=np.full(len(rows), 0.5), heading=unknown)


def main(folder: str) -> None:
    session = open_session(Path(folder))
    analysis = Analysis(session)  # opens the video and knows when each frame was taken
    pipeline = Pipeline(analysis.mission)
    packets = SessionLog(session.tlog).packets()
    packet = next(packets, None)
    named: Counter[int] = Counter()
    assert analysis.video is not None
    for frame in analysis.video.frames():
        if frame.image is None:
            continue
        while packet is not None and packet.t_us <= frame.t_us:  # telemetry first, up to the frame's time
            pipeline.add_packet(packet)
            packet = next(packets, None)
        snapshot = pipeline.add_frame(frame.index, frame.t_us, image=frame.image, detections=detect(frame.image))
        named.update(box.system_id for box in snapshot.boxes if box.system_id)
    for system_id, boxes in sorted(named.items()):
        print(f"{analysis.mission.name_of(system_id)}: {boxes} boxes")
    analysis.close()


if __name__ == "__main__":
    main(sys.argv[1])
