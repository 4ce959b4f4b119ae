"""A telemetry log into numpy: python examples/tlog_to_numpy.py sitl_logs/ardupilot-swarm/telemetry.tlog"""

import sys

import numpy as np

import rollcall

(path,) = sys.argv[1:] or sys.exit(__doc__)
log = rollcall.read_tlog(path)
for system_id in np.unique(log.index.system_id).tolist():
    rows, values = log.columns("GLOBAL_POSITION_INT", system_id)
    if not rows.size:
        continue
    t_s = (log.index.t_us[rows] - log.index.t_us[0]) * 1e-6  # seconds since the log began
    lat_deg, lon_deg = values["lat"] * 1e-7, values["lon"] * 1e-7  # the wire has 1e-7 degrees
    print(
        f"system {system_id}: {rows.size} positions in {t_s[-1] - t_s[0]:.0f} s, "
        f"{lat_deg.min():.5f} to {lat_deg.max():.5f} N, {lon_deg.min():.5f} to {lon_deg.max():.5f} E"
    )
