"""Boxes that err by more of their size than is usual."""

from collections import Counter

import numpy as np
import pytest

from tests.support.snapshots import boxes
from vision.track.tracker import Tracker

STEP_US = 40_000


def lanes(seed, noise_px, frames=250):
    """Eight vehicles of 29 × 19 px, 25 frames a second, that pass each other in lanes 30 px apart."""
    rng = np.random.default_rng(seed)
    place = np.stack([rng.uniform(100, 500, 8), 100.0 + 30.0 * np.arange(8)], axis=1)
    speed = rng.uniform(-15, 15, 8)
    for k in range(frames):
        who = np.flatnonzero(rng.random(8) > 0.14)
        at = place[who] + np.stack([speed[who] * k * 0.04, np.zeros(len(who))], axis=1)
        seen = at + rng.normal(0.0, noise_px, at.shape)
        yield boxes(seen, w=29.0 * rng.normal(1.0, 0.05, len(who)), h=19.0), who


def share_followed(film):
    """Share of the boxes that are of the track which has most of their vehicle's."""
    tracker, of = Tracker(), {}
    for k, (seen, who) in enumerate(film):
        tracks = tracker.update(seen, k * STEP_US)
        owner = {int(d): int(i) for i, d in zip(tracks.track_id, tracks.detection, strict=True) if d >= 0}
        for j, vehicle in enumerate(who.tolist()):
            of.setdefault(vehicle, Counter())[owner.get(j, 0)] += 1
    counts = [Counter({track: n for track, n in each.items() if track}).most_common(1)[0][1] for each in of.values()]
    return sum(counts) / sum(sum(each.values()) for each in of.values())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise_px", [1.0, 3.7])
def test_boxes_that_err_by_a_sixth_of_their_size_are_followed(noise_px, seed):
    assert share_followed(lanes(seed, noise_px)) > 0.8
