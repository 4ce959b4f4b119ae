"""Our tracker beside its peers on the same frames: time of an update, switched ids, fragments, IDF1.

    python -m bench.video.tracker_speed

Peers written from their papers always run; published packages run when they are installed. The trackers take turns, so
that whatever else the machine does slows all alike. Times are processor time of one thread; no matrix is large enough
for a numerical library to start more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.tracker.entrants import OURS, WITH_IDENTITIES, WITH_WARP, Entrant, entrants
from bench.tracker.scene import SimulatedFrame, film
from bench.tracker.scores import TrackingScore

__all__ = ["TrackerLine", "compare", "main", "verdict"]

SCENES = ((7, 6, 300), (50, 2, 250), (200, 1, 150))
"""Vehicles, seeds and frames of each."""
AIMS_MS = {7: 0.15, 50: 0.5, 200: 3.0}
ROUNDS = 3
"""Times that each scene is played; the quickest of each update counts, for shared machines slow now this, now that."""
TURN = 25
"""Frames that a tracker takes before the next one has its turn; the time of a scene's first turn does not count."""


@dataclass(slots=True, kw_only=True)
class TrackerLine:
    """What one tracker made of the scenes of one size."""

    tracker: str
    boxes: int
    ms: list[float] = field(default_factory=list)
    scores: list[TrackingScore] = field(default_factory=list)

    @property
    def median_ms(self) -> float:
        return float(np.median(self.ms))

    @property
    def switches(self) -> int:
        return sum(score.switches for score in self.scores)

    def __str__(self) -> str:
        fragments = sum(score.fragments for score in self.scores)
        idf1 = float(np.mean([score.idf1 for score in self.scores]))
        tail = float(np.percentile(self.ms, 95))
        numbers = f"{self.median_ms:.3f} | {tail:.3f} | {self.switches} | {fragments} | {100 * idf1:.1f}"
        return f"| {self.tracker} | {self.boxes} | {numbers} |"


def compare(n: int, seeds: int, frames: int) -> tuple[list[TrackerLine], list[str]]:
    """All trackers on scenes of n vehicles, and a line for each that cannot run here."""
    lines: dict[str, TrackerLine] = {}
    skipped: list[str] = []
    for seed in range(seeds):
        scene = film(n, seed, frames)
        rounds = []
        for _ in range(ROUNDS):
            made, skipped = entrants()
            rounds.append(_play(scene, made))
        for name in made:
            line = lines.setdefault(name, TrackerLine(tracker=name, boxes=n))
            line.ms += np.min([times[name] for times, _ in rounds], axis=0)[TURN:].tolist()
            line.scores.append(rounds[0][1][name])
    return list(lines.values()), skipped


def _play(
    scene: Sequence[SimulatedFrame], made: Mapping[str, Entrant]
) -> tuple[dict[str, list[float]], dict[str, TrackingScore]]:
    """Times of each tracker, ms, and its score."""
    times: dict[str, list[float]] = {name: [] for name in made}
    scores = {name: TrackingScore() for name in made}
    for start in range(0, len(scene), TURN):
        for name, entrant in made.items():
            for frame in scene[start : start + TURN]:
                track, ms = entrant.step(frame)
                times[name].append(ms)
                scores[name].add(frame.vehicle, track)
    return times, scores


def verdict(lines: Sequence[TrackerLine]) -> str:
    """Our figures of one size against the best peer of the same run."""
    by_name = {line.tracker: line for line in lines}
    peers = [line for line in lines if line.tracker not in (OURS, WITH_WARP, WITH_IDENTITIES)]
    fewest, quickest = min(peers, key=lambda line: line.switches), min(peers, key=lambda line: line.median_ms)
    ours, warped, fed = (by_name[name] for name in (OURS, WITH_WARP, WITH_IDENTITIES))
    aim = AIMS_MS.get(ours.boxes)
    return (
        f"{ours.boxes} boxes: {ours.median_ms:.3f} ms"
        + (f" (aim {aim} ms: {'reached' if ours.median_ms <= aim else 'missed'})" if aim else "")
        + f", quickest peer {quickest.tracker} {quickest.median_ms:.3f} ms; switches {ours.switches}, "
        f"camera motion given {warped.switches}, identities fed in {fed.switches}; "
        f"fewest of a peer {fewest.switches} ({fewest.tracker})"
    )


def main() -> None:
    """Print the table."""
    print("| tracker | boxes | ms median | ms p95 | switches | fragments | IDF1 % |")
    print("|---|---|---|---|---|---|---|")
    verdicts: list[str] = []
    skipped: list[str] = []
    for scene in SCENES:
        lines, skipped = compare(*scene)
        print(*lines, sep="\n", flush=True)
        verdicts.append(verdict(lines))
    print("", *verdicts, *skipped, sep="\n")


if __name__ == "__main__":
    main()
