"""Looking ahead changes when frames are looked at, and nothing else."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from vision.detect.detections import Detections
from vision.errors import ModelError
from vision.video.prefetch import look_ahead
from vision.video.video import Frame


class Slow:
    """Says one box whose place is the frame's brightness; the first frames take longest."""

    def __init__(self, *, fails_at=None):
        self.at_once = self.most = 0
        self.scales = []
        self.looked = 0
        self._lock = threading.Lock()
        self._fails_at = fails_at

    def detect(self, image, *, gsd_m=None):
        with self._lock:
            self.at_once += 1
            self.looked += 1
            self.most = max(self.most, self.at_once)
        value = int(image[0, 0, 0])
        time.sleep(0.02 if value % 2 else 0.001)
        with self._lock:
            self.at_once -= 1
        if value == self._fails_at:
            raise ModelError(f"frame {value}")
        one = np.array([float(value)])
        return Detections(cx=one, cy=one, w=one, h=one, angle=one * 0, score=one * 0 + gsd_m, heading=one * 0)


def frames(n):
    for k in range(n):
        yield Frame(index=k, t_us=1000 * k, image=np.full((4, 4, 3), k, np.uint8))


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_every_frame_once_in_order_with_its_own_scale(workers):
    detector = Slow()
    found = list(look_ahead(frames(12), detector, lambda frame: frame.t_us * 1e-6, workers=workers))
    assert [frame.index for frame, _ in found] == list(range(12))
    assert [boxes.cx[0] for _, boxes in found] == list(range(12))
    np.testing.assert_allclose([boxes.score[0] for _, boxes in found], [1e-3 * k for k in range(12)])
    assert detector.looked == 12
    assert detector.most <= workers


def test_two_at_once():
    detector = Slow()
    list(look_ahead(frames(12), detector, lambda _: 0.1, workers=2))
    assert detector.most == 2


def test_leaving_early_looks_at_no_more():
    detector, decoded = Slow(), []

    def counted():
        for frame in frames(100):
            decoded.append(frame.index)
            yield frame

    ahead = look_ahead(counted(), detector, lambda _: 0.1)
    next(ahead)
    ahead.close()
    assert len(decoded) <= 5
    assert detector.at_once == 0
    assert not [t for t in threading.enumerate() if t.name.startswith("detect")]


def test_what_goes_wrong_is_told_at_its_frame():
    ahead = look_ahead(frames(12), Slow(fails_at=5), lambda _: 0.1)
    seen = []
    with pytest.raises(ModelError, match="frame 5"):
        for frame, _ in ahead:
            seen.append(frame.index)
    assert seen == [0, 1, 2, 3, 4]


def test_no_frames():
    assert list(look_ahead(iter(()), Slow(), lambda _: None)) == []
