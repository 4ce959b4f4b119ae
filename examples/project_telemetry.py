"""Names and reported places on a frame: python examples/project_telemetry.py sitl_logs/curved-road 60 frame.png"""

import sys

import cv2
import numpy as np

import rollcall

folder, index, out = sys.argv[1:] or sys.exit(__doc__)
yellow, white = (0, 255, 255), (255, 255, 255)
for snapshot in rollcall.open(folder).snapshots(images=True):
    if snapshot.frame == int(index) and snapshot.image is not None:
        break
image = np.array(snapshot.image)
inside = [row.expected_px for row in snapshot.vehicles if row.in_view and row.expected_px is not None]
for x, y in inside:  # where the vehicle reports to be
    cv2.drawMarker(image, (round(x), round(y)), yellow, cv2.MARKER_CROSS, 24, 2)
for box in snapshot.boxes:
    corners = cv2.boxPoints(((box.cx, box.cy), (box.w, box.h), np.rad2deg(box.angle)))
    cv2.polylines(image, [np.rint(corners).astype(np.int32)], True, white, 2)
    name = f"{snapshot.name_of(box.system_id)} {box.confidence:.0%}" if box.system_id else "?"
    cv2.putText(image, name, (round(box.cx) + 25, round(box.cy) - 25), cv2.FONT_HERSHEY_SIMPLEX, 0.8, white, 2)
cv2.imwrite(out, image)
print(f"{out}: {len(inside)} vehicles on frame {index}")
