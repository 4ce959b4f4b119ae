"""A flight frame by frame, as a screen shows it: python examples/fold_frame_by_frame.py sitl_logs/ardupilot-swarm"""

import sys

import rollcall

(folder,) = sys.argv[1:] or sys.exit(__doc__)
flight = rollcall.open(folder)
frames = named = 0
for snapshot in flight:
    frames += 1
    named += sum(box.system_id > 0 for box in snapshot.boxes)
    for alarm in snapshot.alarms:
        if alarm.since_us == snapshot.t_us:  # it has just come
            print(f"frame {snapshot.frame}: {alarm.text}; {alarm.advice}")
print(f"{frames} frames, {named / frames:.1f} of {len(flight.mission.ugv)} vehicles named on average")
