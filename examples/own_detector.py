"""Names for the boxes of your own detector: python examples/own_detector.py sitl_logs/curved-road"""

import sys

import cv2
import numpy as np

import rollcall


def detect(image: np.ndarray) -> rollcall.Detections:
    """Oriented boxes (pixels, radians) of what differs in brightness from the ground. Put your network here."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    ground = cv2.resize(cv2.medianBlur(cv2.resize(grey, None, fx=0.25, fy=0.25), 25), grey.shape[::-1])
    _, mask = cv2.threshold(cv2.absdiff(grey, ground), 40, 255, cv2.THRESH_BINARY)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    turned = (cv2.minAreaRect(outline) for outline in outlines if cv2.contourArea(outline) > 200.0)
    found = np.array([(*centre, *size, np.deg2rad(turn), 0.5, np.nan) for centre, size, turn in turned]).reshape(-1, 7)
    cx, cy, w, h, angle, score, heading = found.T
    return rollcall.Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=score, heading=heading)


boxes = (flight := rollcall.open(*sys.argv[1:] or sys.exit(__doc__))).identify(detector=detect)
for system_id, count in zip(*np.unique(boxes["system_id"][boxes["system_id"] > 0], return_counts=True), strict=True):
    print(f"{flight.mission.name_of(int(system_id))}: {count} boxes")
