"""A flight folded frame by frame, as in a notebook: look at any snapshot, keep what you need.

python examples/fold_frame_by_frame.py sitl_logs/ardupilot-swarm
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session


def main(folder: str) -> None:
    analysis = Analysis(open_session(Path(folder)))
    named, residual_m = [], []
    for snapshot in analysis.snapshots(images=False):
        boxes = [box for box in snapshot.boxes if box.system_id]
        named.append(len(boxes))
        residual_m += [box.residual_m for box in boxes]
        for alarm in snapshot.alarms:
            if alarm.since_us == snapshot.t_us:  # it has just come
                print(f"frame {snapshot.frame}: {alarm.text}; {alarm.advice}")
    print(
        f"{len(named)} frames, {np.mean(named):.1f} of {len(analysis.mission.ugv)} vehicles named on average, "
        f"reported and seen {np.nanmedian(residual_m):.1f} m apart (median)"
    )
    analysis.close()


if __name__ == "__main__":
    main(sys.argv[1])
