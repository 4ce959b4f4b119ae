"""A network in 8 bits: a quarter of the size, the same notes, nearly the same map."""

import numpy as np
import pytest

from vision.detect.detector import BUNDLED
from vision.detect.onnx_model import metadata, open_session

pytest.importorskip("onnx")


def test_a_network_in_8_bits_gives_nearly_the_same(tmp_path):
    from training.quantise import quantise

    coarse = np.random.default_rng(0).integers(0, 256, (3, 8, 8, 3), dtype=np.uint8)
    images = np.repeat(np.repeat(coarse, 16, axis=1), 16, axis=2)
    np.savez(tmp_path / "crops_000000.npz", images=images)
    quantise(BUNDLED, tmp_path, tmp_path / "int8.onnx")
    was, now = (open_session(path, ("CPUExecutionProvider",), 1) for path in (BUNDLED, tmp_path / "int8.onnx"))
    assert metadata(now) == metadata(was)
    assert (tmp_path / "int8.onnx").stat().st_size < BUNDLED.stat().st_size / 3
    a, b = (session.run(None, {"image": images[:1]})[0] for session in (was, now))
    # of what lies in random pixels nothing is sure: all but the score tells of every cell
    assert [np.corrcoef(a[0, k].ravel(), b[0, k].ravel())[0, 1] > 0.9 for k in range(1, a.shape[1])] == [True] * 8
