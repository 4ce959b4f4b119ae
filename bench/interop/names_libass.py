"""Whether libass draws every name of an exported film at its vehicle: frames are drawn with one name each.

pip install imageio-ffmpeg pysubs2
python bench/interop/names_libass.py FILM.mkv BOXES.csv
"""

from __future__ import annotations

import csv
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

FRAMES = 6
"""That are drawn, evenly over the film."""


def drawn(ffmpeg: str, film: Path, time_s: float, subtitles: Path | None, size: tuple[int, int]) -> NDArray[np.int16]:
    """A frame (height, width, 3) as a player shows it."""
    options = ["-vf", f"ass={subtitles}"] if subtitles else []
    seek = ["-ss", f"{max(0.0, time_s - 0.001):.3f}", "-copyts"]
    command = [ffmpeg, "-v", "error", *seek, "-i", str(film), *options, "-frames:v", "1", "-f", "rawvideo"]
    raw = subprocess.run([*command, "-pix_fmt", "rgb24", "-"], stdout=subprocess.PIPE, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(size[1], size[0], 3).astype(np.int16)


def gap_px(area: tuple[int, int, int, int], box: dict[str, str]) -> float:
    """Between what was drawn (left, top, right, bottom) and the vehicle's outline, taken as a circle of its length."""
    x, y, reach = float(box["cx_px"]), float(box["cy_px"]), max(float(box["w_px"]), float(box["h_px"])) / 2
    across = max(area[0] - x, x - area[2], 0.0)
    down = max(area[1] - y, y - area[3], 0.0)
    return max(0.0, float(np.hypot(across, down)) - reach)


def main() -> None:
    import av
    import imageio_ffmpeg
    import pysubs2

    film, table = Path(sys.argv[1]), Path(sys.argv[2])
    ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    boxes: dict[int, list[dict[str, str]]] = defaultdict(list)
    with table.open() as file:
        for row in csv.DictReader(file):
            if row["name"]:
                boxes[int(row["frame"])].append(row)
    with av.open(str(film)) as container:
        stream = container.streams.video[0]
        size = stream.codec_context.width, stream.codec_context.height
        tick = stream.time_base
        times_s = sorted(float(p.pts * tick) for p in container.demux(stream) if p.pts is not None and tick is not None)
    print(f"# Names of {film.name}, drawn by libass of FFmpeg {imageio_ffmpeg.get_ffmpeg_version()}\n")
    print("| frame | time, s | names | drawn | farthest from its vehicle's outline, px |\n|---:|---:|---:|---:|---:|")
    with TemporaryDirectory() as folder:
        whole = Path(folder) / "all.ass"
        subprocess.run([ffmpeg, "-v", "error", "-i", str(film), "-map", "0:s", str(whole)], check=True)
        for frame in np.linspace(0, len(times_s) - 1, FRAMES).round().astype(int).tolist():
            bare = drawn(ffmpeg, film, times_s[frame], None, size)
            gaps = []
            for box in boxes[frame]:
                lines = pysubs2.load(str(whole))
                lines.events = [line for line in lines if line.plaintext.startswith(box["name"])]
                one = Path(folder) / "one.ass"
                lines.save(str(one))
                changed = np.abs(drawn(ffmpeg, film, times_s[frame], one, size) - bare).max(axis=2) > 40
                rows, columns = np.nonzero(changed)
                if len(rows):
                    area = int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())
                    gaps.append(gap_px(area, box))
            far = f"{max(gaps):.0f}" if gaps else "–"
            print(f"| {frame} | {times_s[frame]:.3f} | {len(boxes[frame])} | {len(gaps)} | {far} |", flush=True)


if __name__ == "__main__":
    main()
