"""What a station believed of its own recording, as one JSON object a line on stdout.

Run by the interpreter of the station that is under test, with a session folder as its argument: it folds the recording
as ``gcs replay`` does, five times a second. Places are relative to the UAV's, so the origin does not matter.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from gcs.snapshot import Snapshot


def said(snapshot: Snapshot) -> str:
    uav = snapshot.uav_enu
    rows = {}
    for row in snapshot.vehicles:
        east, north = (float(row.p_enu[k] - uav[k]) for k in (0, 1))
        rows[row.system_id] = {
            "place": [east, north] if math.isfinite(east) and math.isfinite(north) else None,
            "state": row.position_state,
            "contested": row.contested,
            "beat": row.heartbeat_age_s < 3.5,
        }
    return json.dumps({"t_us": snapshot.t_us, "rows": rows, "alarms": sorted(alarm.key for alarm in snapshot.alarms)})


def main() -> None:
    for snapshot in Analysis(open_session(Path(sys.argv[1]))).snapshots(images=False):
        sys.stdout.write(said(snapshot) + "\n")


if __name__ == "__main__":
    main()
