"""Your own export, a line a second and vehicle: python examples/own_export.py sitl_logs/ardupilot-swarm seen.txt"""

import sys
from pathlib import Path

import rollcall

folder, out = sys.argv[1:] or sys.exit(__doc__)
due_us = 0
with Path(out).open("x", encoding="utf-8") as file:  # "x": never over what is there
    for snapshot in rollcall.open(folder):
        if snapshot.t_us < due_us:
            continue
        due_us = snapshot.t_us + 1_000_000
        for box in snapshot.boxes:
            if box.system_id:  # 0 is unknown
                name, east_m, north_m = snapshot.name_of(box.system_id), *box.p_enu[:2]
                file.write(f"{snapshot.t_us} {name} {box.confidence:.2f} {east_m:.1f} {north_m:.1f}\n")
print(out)
