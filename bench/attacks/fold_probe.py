"""The fleet's state as the station under test estimates it from its own recording, one JSON object a line on stdout.

Run by that station's interpreter with a session folder as its argument: it replays the recording as ``gcs replay``
does, five times a second. Positions are relative to the UAV, so the local origin does not matter.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from gcs.snapshot import Snapshot

HEARTBEAT_MAX_S = 3.5
"""Age up to which a heartbeat counts as recent."""


def snapshot_json(snapshot: Snapshot) -> str:
    """Time, vehicles by system id and keys of the alarms of a snapshot."""
    uav = snapshot.uav_enu
    rows = {}
    for row in snapshot.vehicles:
        east, north = (float(row.p_enu[k] - uav[k]) for k in (0, 1))
        rows[row.system_id] = {
            "place": [east, north] if math.isfinite(east) and math.isfinite(north) else None,
            "state": row.position_state,
            "contested": row.contested,
            "beat": row.heartbeat_age_s < HEARTBEAT_MAX_S,
        }
    return json.dumps({"t_us": snapshot.t_us, "rows": rows, "alarms": sorted(alarm.key for alarm in snapshot.alarms)})


def main() -> None:
    for snapshot in Analysis(open_session(Path(sys.argv[1]))).snapshots(images=False):
        sys.stdout.write(snapshot_json(snapshot) + "\n")


if __name__ == "__main__":
    main()
