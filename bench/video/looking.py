"""Processor time of a look by height: at the whole picture, and as a flight looks, in turns where that takes too long.

``python -m bench.video.looking``: one thread, the bundled detector, a usual lens that looks straight down (65° across).
"""

from __future__ import annotations

import time

from bench.command_line import parser_of, write_table
from gcs.health.detector_speed import ground_sampling, seconds_a_frame
from infra.markdown import markdown_table
from vision.detect.detector import open_detector
from vision.detect.turns import in_turns

HEIGHTS_M = (30.0, 60.0, 90.0, 120.0, 150.0)
SIZES = ((1920, 1080), (3840, 2160))
HEADING = ("width", "height_m", "whole_ms", "flight_ms", "in_turns")


def main() -> None:
    """Measure and print."""
    args = parser_of("looking", __doc__ or "", "1080p alone").parse_args()
    detector = open_detector()
    rows = []
    for size in SIZES[:1] if args.quick else SIZES:
        for height_m in HEIGHTS_M:
            gsd_m = ground_sampling(height_m, size[0])
            whole_s = seconds_a_frame(detector, gsd_m, size, whole=True, clock=time.process_time)
            flight_s = seconds_a_frame(detector, gsd_m, size, clock=time.process_time)
            turns = in_turns(detector, size, gsd_m)
            rows.append((size[0], height_m, round(whole_s * 1e3, 1), round(flight_s * 1e3, 1), int(turns)))
    write_table(args.out / "looking.csv", HEADING, rows)
    cells = [
        (str(width), f"{height_m:g}", f"{whole:g}", f"{flight:g}{' in turns' * turns}", f"{flight / whole:.2f}")
        for width, height_m, whole, flight, turns in rows
    ]
    print(markdown_table(("picture", "height, m", "whole, ms", "in flight, ms", "ratio"), cells))


if __name__ == "__main__":
    main()
