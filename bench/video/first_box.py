"""From the start of the program until the first vehicle is found in the video.

    python -m bench.video.first_box [--runs 5]

Each run is a flight of its own, without a screen, with the bundled film for a camera; it begins when the process does
and ends when the flight has recorded a box.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.command_line import count
from bench.ports import free_port
from infra.session_format import DETECTIONS

FLIGHT = Path("sitl_logs/curved-road")
LONGEST_S = 60.0
LOOK_S = 0.01


def first_box_s() -> float:
    """Seconds from start to first box; inf if none came."""
    with tempfile.TemporaryDirectory() as folder:
        words = ("fly", FLIGHT / "session.toml", "-l", f"udpin:127.0.0.1:{free_port()}", "-v", FLIGHT / "video.mp4")
        command = [str(Path(sys.executable).with_name("gcs")), *map(str, words), "--headless", "--sessions", folder]
        began_s = time.monotonic()
        flight = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            while (lasted_s := time.monotonic() - began_s) < LONGEST_S and flight.poll() is None:
                if any(
                    table.stat().st_size > len(DETECTIONS.header) for table in Path(folder).glob("*/detections.csv")
                ):
                    return lasted_s
                time.sleep(LOOK_S)
            return float("inf")
        finally:
            flight.terminate()
            flight.wait(LONGEST_S)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.video.first_box", description="Start to first box")
    parser.add_argument("--runs", type=count, default=5)
    lasted_s = [first_box_s() for _ in range(parser.parse_args().runs)]
    print("start to first box, s:", " ".join(f"{each:.2f}" for each in lasted_s))
    print(f"median {statistics.median(lasted_s):.2f} s")


if __name__ == "__main__":
    main()
