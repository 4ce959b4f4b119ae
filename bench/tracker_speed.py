"""How long one tracker update takes, and how often ids switch, on a generated scene.

Vehicles drive at constant speed and bounce off the borders of a 1920 × 1080 picture at 30 per second. The detector adds
noise of 1.5 px, misses 4 % of the boxes, hides each for 3 to 20 pictures now and then, gives a tenth of the boxes a low
score and adds 1 % false ones.

    python -m bench.tracker_speed
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from vision.detections import Detections
from vision.tracker import Tracker

PICTURES = 500
SIZE = np.array([1920.0, 1080.0])
STEP_US = 33_333


def scene(n: int, seed: int) -> list[tuple[Detections, NDArray[np.int64]]]:
    """Per picture the detections and the vehicle of each, -1 for a false box."""
    rng = np.random.default_rng(seed)
    side = np.stack([rng.uniform(52, 68, n), rng.uniform(24, 32, n)], axis=1)
    place = rng.uniform(60, SIZE - 60, (n, 2))
    course = rng.uniform(0, 2 * np.pi, n)
    step = rng.uniform(1.5, 6, n)[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
    hidden = np.zeros(n, dtype=int)
    out = []
    for _ in range(PICTURES):
        place = place + step
        step = np.where((place < 40) | (place > SIZE - 40), np.sign(SIZE / 2 - place) * np.abs(step), step)
        hidden = np.where(hidden > 0, hidden - 1, np.where(rng.random(n) < 1 / 120, rng.integers(3, 21, n), 0))
        out.append(detect(place, step, side, hidden, rng))
    return out


def detect(
    place: NDArray[np.float64],
    step: NDArray[np.float64],
    side: NDArray[np.float64],
    hidden: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[Detections, NDArray[np.int64]]:
    """What a detector reports of vehicles at ``place`` (n, 2)."""
    n = len(place)
    who = rng.permutation(np.nonzero((hidden == 0) & (rng.random(n) > 0.04))[0])
    false = rng.binomial(n, 0.01)
    centre = np.concatenate([place[who] + rng.normal(0, 1.5, (len(who), 2)), rng.uniform(0, SIZE, (false, 2))])
    sides = np.concatenate([side[who] + rng.normal(0, 1, (len(who), 2)), np.tile([60.0, 28.0], (false, 1))])
    angle = np.concatenate([np.arctan2(step[who, 1], step[who, 0]), rng.uniform(-np.pi, np.pi, false)])
    weak = rng.random(len(angle)) < 0.1
    boxes = Detections(
        cx=centre[:, 0],
        cy=centre[:, 1],
        w=sides[:, 0],
        h=sides[:, 1],
        angle=angle,
        score=np.where(weak, rng.uniform(0.15, 0.5, len(angle)), rng.uniform(0.6, 0.95, len(angle))),
        heading=np.mod(angle + np.pi / 2, 2 * np.pi),
    )
    return boxes, np.concatenate([who, np.full(false, -1)])


def follow(
    pictures: list[tuple[Detections, NDArray[np.int64]]],
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Wall and processor time of each update, ms, and the number of id switches."""
    tracker, last, switches = Tracker(), dict[int, int](), 0
    wall, cpu = np.empty(len(pictures)), np.empty(len(pictures))
    for i, (boxes, who) in enumerate(pictures):
        wall_s, cpu_s = time.perf_counter(), time.thread_time()
        tracks = tracker.update(boxes, i * STEP_US)
        wall[i], cpu[i] = 1e3 * (time.perf_counter() - wall_s), 1e3 * (time.thread_time() - cpu_s)
        for track_id, detection in zip(tracks.track_id.tolist(), tracks.detection.tolist(), strict=True):
            vehicle = int(who[detection]) if detection >= 0 else -1
            if vehicle >= 0:
                switches += last.get(vehicle, track_id) != track_id
                last[vehicle] = track_id
    return wall, cpu, switches


def main() -> None:
    """Print the table."""
    print(f"{PICTURES} pictures per scene; times in ms per update\n")
    print("| boxes | wall median | cpu median | cpu p95 | switches, seeds 0-2 |")
    print("|---|---|---|---|---|")
    for n in (7, 50, 200):
        runs = [follow(scene(n, seed)) for seed in range(3)]
        wall, cpu = min(np.median(run[0]) for run in runs), [run[1] for run in runs]
        best = min(cpu, key=lambda times: float(np.median(times)))
        switches = " ".join(str(run[2]) for run in runs)
        print(f"| {n} | {wall:.2f} | {np.median(best):.2f} | {np.percentile(best, 95):.2f} | {switches} |")


if __name__ == "__main__":
    main()
