"""Camera motion from the pixels of rendered flights whose camera shakes.

    python -m bench.motion
    python -m bench.motion --seeds 3 --seconds 15 --write bench/results/motion.md

Each flight of the shaking families of ``bench.field`` is rendered, its frames are compressed and compared, and named
with what the comparison found and without it. One thread; processor time.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from bench.field.families import FAMILIES, label_of, scenario_of, seeds_of
from bench.field.measure import BoxCounts, tally
from bench.field.product import identify
from bench.motion.rendered import write_motion
from infra.session_format import MOTION
from sim.session import write_session

SHAKING = next(number for number, family in FAMILIES.items() if family.name == "shaking")
HEAD = (
    "| flight | moves px | off px, median, p95 | turn off °, median, p95 | in its σ² | none | ms, median, p95 "
    "| names without, right | with | tracks |\n|---|---|---|---|---|---|---|---|---|---|"
)


def lines(seeds: int, seconds: float) -> Iterator[str]:
    """A row of the table for each flight."""
    for hard in (False, True):
        kinds = len(seeds_of(SHAKING, hard, "tune"))
        for seed in range(min(kinds * seeds, 100)):
            scenario = replace(scenario_of(SHAKING, hard, seed), duration_s=seconds)
            with tempfile.TemporaryDirectory(prefix="motion-") as place:
                session = Path(place) / "session"
                write_session(scenario, session)
                errors = write_motion(scenario, session)
                seen, tracks = _named(session, Path(place) / "with", scenario.fps)
                (session / MOTION.name).unlink()
                blind, blind_tracks = _named(session, Path(place) / "without", scenario.fps)
            wobble = f"{scenario.flight.wobble_deg:.1f}°, {scenario.flight.wobble_tau_s:.2f} s"
            cells = (
                f"{wobble}, {label_of(SHAKING, hard, seed)}",
                f"{np.median(errors.moved_px):.0f}",
                f"{np.median(errors.error_px):.2f}, {np.percentile(errors.error_px, 95):.2f}",
                f"{np.nanmedian(errors.turn_error_deg):.3f}, {np.nanpercentile(errors.turn_error_deg, 95):.3f}",
                f"{np.nanmean(errors.turn_surprise) / 3:.1f}",
                f"{errors.none}",
                f"{np.median(errors.cpu_ms):.1f}, {np.percentile(errors.cpu_ms, 95):.1f}",
                _rates(blind),
                _rates(seen),
                f"{blind_tracks} → {tracks}",
            )
            yield f"| {' | '.join(cells)} |"


def _named(session: Path, out: Path, fps: float) -> tuple[BoxCounts, int]:
    matched = identify(session, out).matched
    return tally(matched, fps), len(np.unique(matched.track[matched.track > 0]))


def _rates(counts: BoxCounts) -> str:
    """Precision and the share of our boxes that are named rightly, %, and seconds wrong at 0.9 or more."""
    right = 100 * counts.right
    return f"{right / max(counts.named, 1):.1f}, {right / max(counts.ours, 1):.1f}, {counts.wrong_sure_s:.1f} s"


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="draws of each kind of flight")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of each flight")
    parser.add_argument("--write", type=Path, help="file for the table")
    chosen = parser.parse_args()
    cv2.setNumThreads(1)
    table = HEAD
    print(HEAD)
    for line in lines(chosen.seeds, chosen.seconds):
        print(line, flush=True)
        table += f"\n{line}"
    if chosen.write:
        chosen.write.write_text(f"# Camera motion from the pixels\n\n`python -m bench.motion`\n\n{table}\n")


if __name__ == "__main__":
    main()
