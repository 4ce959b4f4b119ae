"""How much later a shown picture is seen: from a snapshot in the station to its decoded picture on the same computer.

python -m bench.live_out [--seconds 20] [--fps 30]
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import av
import numpy as np
import psutil
from av.codec.context import Flags
from numpy.typing import NDArray

from bench.ports import free_port
from gcs.live_out.hand_over import SnapshotWriter
from gcs.live_out.live_out import LiveOut
from gcs.live_out.picture import sdp
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import SinkUrl, parse_show
from gcs.snapshot import Box, Health, Snapshot

RESULT = Path("bench-results/live_out.md")
SIZES = ((1280, 720), (1920, 1080))
BITS, SIDE = 14, 40
"""A picture's number is in it as dark and light squares."""
HAND_OVERS = 300
SETTLE = 30
"""Pictures until a receiver has found out what comes."""


@dataclass
class PacedCamera:
    """Makes snapshots at a steady pace, each of which is dated when it is first seen."""

    size: tuple[int, int]
    fps: float
    made_s: dict[int, float] = field(default_factory=dict)
    shown: Snapshot | None = None

    def __post_init__(self) -> None:
        width, height = self.size
        rng = np.random.default_rng(1)
        self._ground = rng.integers(70, 130, (height // 4, width // 4, 3), dtype=np.uint8).repeat(4, 0).repeat(4, 1)
        self._begin_s = time.monotonic()

    def latest(self) -> Snapshot:
        """The newest snapshot, as a flight has it."""
        number = int((time.monotonic() - self._begin_s) * self.fps)
        if self.shown is None or self.shown.frame != number:
            image = np.roll(self._ground, 4 * number % self.size[0], axis=1)
            write_number(image, number)
            self.shown = snapshot(number, image)
            self.made_s[number] = time.monotonic()
        return self.shown


def write_number(image: NDArray[np.uint8], number: int) -> None:
    """A row of squares at the lower edge."""
    for bit in range(BITS):
        image[-SIDE:, bit * SIDE : (bit + 1) * SIDE] = 255 if number >> bit & 1 else 0


def read_number(grey: NDArray[np.uint8]) -> int:
    """What :func:`write_number` wrote."""
    middle = grey[-SIDE // 2, SIDE // 2 : BITS * SIDE : SIDE]
    return sum(1 << bit for bit, value in enumerate(middle) if value > 127)


def snapshot(number: int, image: NDArray[np.uint8]) -> Snapshot:
    """Ten boxes on a picture."""
    boxes = tuple(
        Box(track_id=i, cx=90.0 * i, cy=200.0, w=50.0, h=25.0, angle=0.3 * i, heading=0.0, score=0.9, confidence=0.9)
        for i in range(1, 11)
    )
    nowhere = np.full(3, np.nan)
    return Snapshot(
        t_us=1_795_171_704_000_000 + number,
        frame=number,
        width=image.shape[1],
        height=image.shape[0],
        image=image,
        vehicles=(),
        boxes=boxes,
        footprint_enu=None,
        uav_enu=nowhere,
        uav_heading=np.nan,
        health=Health(),
    )


def lags(url: SinkUrl, camera: PacedCamera, seconds: float, folder: Path) -> tuple[list[float], float]:
    """Seconds from snapshot to decoded picture, and processor time of the sink's process for each picture, s."""
    address, options = f"udp://127.0.0.1:{url.port}", {"fflags": "nobuffer", "analyzeduration": "500000"}
    if url.scheme == "rtp":
        address = str(folder / "stream.sdp")
        Path(address).write_text(sdp(url), newline="")
        options["protocol_whitelist"] = "file,udp,rtp"
    found: list[float] = []
    with LiveOut(camera.latest, [url], SinkSource(name="bench"), print) as telling:
        with av.open(address, options=options, timeout=30.0) as film:
            stream = film.streams.video[0]
            stream.codec_context.flags |= Flags.low_delay
            stream.thread_type = "SLICE"
            for frame in film.decode(stream):
                now_s = time.monotonic()
                number = read_number(np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8))
                found.append(now_s - camera.made_s.get(number, np.nan))
                if len(found) > SETTLE + seconds * camera.fps or now_s > camera._begin_s + 3 * seconds + 30:
                    break
        process = psutil.Process(telling.outlets[0].supervisor.process.pid).cpu_times()
        sent = max(telling.outlets[0].latest.sent, 1)
    return found[SETTLE:], (process.user + process.system) / sent


def hand_over_ms(size: tuple[int, int], *, images: bool) -> float:
    """Processor time that a snapshot costs the station, median, ms."""
    writer, camera = SnapshotWriter(images=images), PacedCamera(size, 30.0)
    shown, costs = camera.latest(), []
    for _ in range(HAND_OVERS):
        begin_s = time.thread_time()
        writer.put(shown)
        costs.append(time.thread_time() - begin_s)
    writer.close()
    return 1e3 * statistics.median(costs)


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.live_out", description="Lag of a shown picture.")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each (%(default)s)")
    parser.add_argument("--fps", type=float, default=30.0)
    given = parser.parse_args()
    rows = []
    for scheme in ("udp", "rtp"):
        for size in SIZES:
            camera = PacedCamera(size, given.fps)
            with tempfile.TemporaryDirectory() as folder:
                url = parse_show(f"{scheme}://127.0.0.1:{free_port()}")
                found, cpu_s = lags(url, camera, given.seconds, Path(folder))
            high = statistics.quantiles(found, n=20)[-1]
            rows.append(
                f"| `{scheme}://` | {size[0]}×{size[1]} | {len(found)} | {statistics.median(found):.3f} | {high:.3f} | "
                f"{max(found):.3f} | {1e3 * cpu_s:.0f} |"
            )
            print(rows[-1], flush=True)
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(
        "# Lag of a shown picture\n\n"
        f"`python -m bench.live_out --seconds {given.seconds:g} --fps {given.fps:g}`: from a snapshot in the station\n"
        "to its decoded picture (FFmpeg) on the same computer, with hand-over, drawing, encoding, UDP and decoding.\n\n"
        "| | picture | received | median, s | 95 %, s | longest, s | sink's processor, ms a picture |\n"
        "|---|---|---|---|---|---|---|\n" + "\n".join(rows) + "\n\n"
        f"The station itself spends {hand_over_ms(SIZES[1], images=False):.2f} ms of processor on handing a snapshot "
        f"over, {hand_over_ms(SIZES[1], images=True):.2f} ms\nwith a picture of {SIZES[1][0]}×{SIZES[1][1]}.\n"
    )


if __name__ == "__main__":
    main()
