"""Who is who in a recording, and how right that is: python examples/names_of_a_flight.py sitl_logs/curved-road"""

import sys

import numpy as np

import rollcall

(folder,) = sys.argv[1:] or sys.exit(__doc__)
flight = rollcall.open(folder)
boxes = flight.identify()
for system_id in np.unique(boxes["system_id"][boxes["system_id"] > 0]).tolist():
    one = boxes.where(boxes["system_id"] == system_id)
    apart_m, sure = np.nanmedian(one["residual_m"]), np.nanmean(one["confidence"])
    print(
        f"{flight.mission.name_of(system_id)}: {one.rows} boxes, {sure:.0%} sure, seen {apart_m:.1f} m from its report"
    )
print(f"names that are right: {rollcall.score(boxes, flight.truth).precision:.1%}")
