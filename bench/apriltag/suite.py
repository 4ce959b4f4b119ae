"""Runs all heights and cameras in worker processes and writes the result files."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from bench.apriltag.case import TagCase, TagOutcome, play
from bench.apriltag.figure import draw_heights
from bench.apriltag.flight import CAMERAS
from bench.apriltag.tables import report as tables
from bench.apriltag.tables import write_csv
from bench.drawing import MISSING

__all__ = ["cases", "run"]

WORKERS = 2
"""One for each core of a small machine."""
HEIGHTS_M = (10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 100.0, 120.0)
QUICK_HEIGHTS_M = (10.0, 40.0, 120.0)
DURATION_S, FPS = 8.0, 4.0
QUICK_S = 5.0
"""Length of a quick flight: one second after the results settle."""
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit numerical libraries to one thread in each worker."""


def cases(quick: bool) -> list[TagCase]:
    """The flights of a run, the longest first."""
    heights, duration_s = (QUICK_HEIGHTS_M, QUICK_S) if quick else (HEIGHTS_M, DURATION_S)
    cameras = [camera for camera in reversed(CAMERAS) if not quick or camera == "1080p"]
    return [TagCase(camera=c, height_m=h, duration_s=duration_s, fps=FPS) for c in cameras for h in reversed(heights)]


def run(
    out: Path,
    quick: bool = False,
    *,
    workers: int = WORKERS,
    print_note: Callable[[str], None] = lambda _: None,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> str:
    """Run all flights; write ``apriltag.md``, ``apriltag.csv`` and ``apriltag.png``.

    Args:
        out: is made; files of these names in it are replaced.
        quick: a few heights and one camera.
        workers: number of processes.
        print_note: called with messages about the run that are not part of its tables.
        report: called with the numbers of finished flights and of all flights.

    Returns:
        the text of ``apriltag.md``.
    """
    began = time.monotonic()
    outcomes = sorted(_played(cases(quick), workers, report), key=lambda o: (o.case.camera, o.case.height_m))
    out.mkdir(parents=True, exist_ok=True)
    write_csv(outcomes, out / "apriltag.csv")
    text = tables(outcomes, quick)
    (out / "apriltag.md").write_text(text, encoding="utf-8")
    if not draw_heights(out / "apriltag.csv", out / "apriltag.png"):
        print_note(MISSING)
    print_note(f"{len(outcomes)} flights in {time.monotonic() - began:.0f} s; wrote {out}")
    return text


def _played(todo: list[TagCase], workers: int, report: Callable[[int, int], None]) -> list[TagOutcome]:
    outcomes = []
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    # numerical libraries read these when a worker loads them
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            for done in as_completed([pool.submit(_one, case) for case in todo]):
                outcomes.append(done.result())
                report(len(outcomes), len(todo))
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
    return outcomes


def _one(case: TagCase) -> TagOutcome:
    import cv2

    cv2.setNumThreads(1)
    return play(case)
