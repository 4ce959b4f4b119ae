"""Flights with every trouble there is, recorded and identified again: how many rows differ.

    python -m bench.again
    python -m bench.again --seeds 5 --seconds 60 --write bench/results/again.md

Every trouble alone, then all that go together in one flight, in simulated time (``bench.again.scripted``).
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from dataclasses import replace
from pathlib import Path

from bench.again.scripted import InjectedFaults, fly
from gcs.cli.identify import identify_into
from gcs.session.session import open_session
from sim.world.presets import nominal

FLIGHTS = {
    "none": InjectedFaults(),
    "the stream changes its size": InjectedFaults(resized_s=8.0),
    "the fleet is switched off and on": InjectedFaults(restart=(6.0, 10.0)),
    "the same, without frames meanwhile": InjectedFaults(restart=(6.0, 10.0), no_video=((6.0, 12.5),)),
    "no frames for 4 s": InjectedFaults(no_video=((5.0, 9.0),)),
    "no telemetry for 4 s": InjectedFaults(no_telemetry=(5.0, 9.0)),
    "frames stamped 0.36 s late": InjectedFaults(late_stamp_s=0.361),
    "the clock is set ahead by an hour": InjectedFaults(step=(8.0, 3600.0)),
    "the clock is set back by an hour": InjectedFaults(step=(8.0, -3600.0)),
    "the clock is set ahead by 0.4 s": InjectedFaults(step=(8.0, 0.4)),
    "a second link, 1.5 s late": InjectedFaults(second_link_s=1.5),
    "a second link, 8 s late": InjectedFaults(second_link_s=8.0),
    "an impostor for 7 s": InjectedFaults(impostor=(5.0, 12.0)),
    "the receiving process is killed twice": InjectedFaults(killed_s=(4.0, 9.0)),
    "the fold stands still for 3 s and packets are passed over": InjectedFaults(
        ring_bytes=8192, fold_stalled=(5.0, 8.0)
    ),
    "the station speaks": InjectedFaults(station_sends=True),
    "a signed fleet, and somebody who forges": InjectedFaults(signed=True),
    "nothing is seen for 3 s": InjectedFaults(no_detections=(5.0, 8.0)),
    "the detector fails for a second": InjectedFaults(detector_fails=(5.0, 6.0)),
    "all together": InjectedFaults(
        resized_s=14.0,
        restart=(6.0, 9.0),
        no_telemetry=(3.0, 4.0),
        no_video=((16.0, 17.0),),
        late_stamp_s=0.2,
        step=(12.0, 0.6),
        second_link_s=2.5,
        impostor=(13.0, 15.0),
        killed_s=(2.0, 13.5),
        station_sends=True,
        no_detections=(15.0, 15.6),
        detector_fails=(17.5, 18.0),
    ),
}


def compared(folder: Path, seed: int, seconds: float, faults: InjectedFaults) -> tuple[int, int, int]:
    """Rows, rows with a name, and rows that differ."""
    session = fly(folder, replace(nominal(seed), duration_s=seconds), faults)
    with contextlib.redirect_stderr(io.StringIO()):
        identify_into(open_session(session), folder / "again")
    live, again = ((place / "identity.jsonl").read_text().splitlines() for place in (session, folder / "again"))
    different = sum(one != other for one, other in zip(live, again, strict=False)) + abs(len(live) - len(again))
    return len(live), sum('"name":null' not in row for row in live), different


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--write", type=Path, help="put the table into this file")
    options = parser.parse_args()
    lines = ["| trouble | rows | named | rows that differ |", "|---|---|---|---|"]
    for name, faults in FLIGHTS.items():
        counts = [0, 0, 0]
        for seed in range(1, options.seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                found = compared(Path(folder), seed, options.seconds, faults)
            counts = [so_far + more for so_far, more in zip(counts, found, strict=True)]
        lines.append(f"| {name} | {counts[0]:,} | {counts[1]:,} | **{counts[2]}** |")
        print(lines[-1], flush=True)
    if options.write:
        about = (__doc__ or "").strip()
        options.write.write_text(f"# Flights identified again\n\n{about}\n\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
