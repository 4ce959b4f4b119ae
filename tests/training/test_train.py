"""How training runs: batches by processes, light, and a model between two; needs torch."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from vision.detect.detector import BUNDLED
from vision.detect.onnx_model import open_session
from vision.errors import ModelError

torch = pytest.importorskip("torch", reason="needs the extra 'train'")
onnx = pytest.importorskip("onnx", reason="needs the extra 'train'")


@pytest.fixture
def mixture(tmp_path):
    from training.data import Mixture, Pool

    rng = np.random.default_rng(0)
    boxes = np.zeros((4, 80, 6), np.float32)
    boxes[:, 0] = (192.0, 192.0, 60.0, 26.0, 0.4, 1.0)
    images = rng.integers(0, 256, (4, 384, 384, 3), dtype=np.uint8)
    np.savez(tmp_path / "crops_000000.npz", images=images, boxes=boxes, n=np.ones(4, int), about=np.zeros((4, 5)))
    pool = Pool(folder=tmp_path)
    assert pool.refresh() == 4
    return Mixture(rendered=pool, photographs=(), seed=3)


@pytest.mark.filterwarnings("default:.*fork.*")
def test_processes_make_the_batches_that_a_thread_makes(mixture):
    from training.train import batches

    alone = list(batches(mixture, range(5, 8), 3))
    together = list(batches(mixture, range(5, 8), 3, workers=2))
    assert len(alone) == len(together) == 3
    for one, other in zip(alone, together, strict=True):
        assert one.images.dtype == torch.uint8 and one.images.shape == (3, 3, 256, 256)
        assert torch.equal(one.images, other.images)
        assert torch.equal(one.boxes, other.boxes)
    assert not torch.equal(alone[0].images, alone[1].images)


@pytest.mark.slow
def test_training_ends_when_its_minutes_are_over(mixture, tmp_path):
    from training.train import run

    for name in ("pool", "held_out"):
        (tmp_path / name).mkdir()
        shutil.copy(tmp_path / "crops_000000.npz", tmp_path / name)
    run(
        tmp_path, seed=0, steps=9999, minutes=0.005, rate=1e-3, threads=1, batch=2, workers=0, crops=0, renderers=1,
        check_every=9999, start=None, photographs=(),
    )  # fmt: skip
    lines = (tmp_path / "quality.csv").read_text().splitlines()
    assert len(lines) == 2
    assert 1 <= int(lines[1].split(",")[0]) < 9999
    assert (tmp_path / "model.onnx").exists()


def test_some_images_lose_their_colours_and_some_become_negatives():
    from training.data import _light

    image = np.zeros((8, 8, 3), np.uint8)
    image[:4] = (30, 60, 120)
    image[4:] = (90, 180, 240)
    made = [_light(image, np.random.default_rng(seed)).astype(int) for seed in range(300)]
    grey = [m for m in made if np.ptp(m, axis=-1).max() == 0]
    negative = [m for m in grey if m[:4].mean() > m[4:].mean()]
    assert 15 <= len(grey) <= 60
    assert 0.25 * len(grey) <= len(negative) <= 0.75 * len(grey)


def test_averages_are_those_of_the_weights_of_all_steps(mixture):
    from training.train import Trainer

    trainer = Trainer(0, "cpu", 1e-3)
    name = "head.weight"
    seen = [trainer.net.state_dict()[name].clone()]
    for step in range(3):
        trainer.step(mixture.batch(step, 2), 0.0)
        seen.append(trainer.net.state_dict()[name].clone())
    # while fewer than the averaged steps are done, all count alike
    torch.testing.assert_close(trainer.average[name], torch.stack(seen).mean(dim=0))
    assert int(trainer.average["stem.0.norm.num_batches_tracked"]) == 3


def test_a_blend_lies_between_and_its_ends_are_the_files(tmp_path):
    from training.blend import blend

    other = onnx.load(str(BUNDLED))
    for weight in other.graph.initializer:
        values = onnx.numpy_helper.to_array(weight)
        if values.dtype == np.float32 and values.ndim == 4:
            weight.CopyFrom(onnx.numpy_helper.from_array(values * np.float32(1.5), weight.name))
    onnx.save(other, str(tmp_path / "other.onnx"))

    def first_kernel(model):
        return next(a for a in map(onnx.numpy_helper.to_array, model.graph.initializer) if a.ndim == 4)

    ends = [first_kernel(blend(BUNDLED, tmp_path / "other.onnx", share)) for share in (0.0, 0.5, 1.0)]
    np.testing.assert_array_equal(ends[0], first_kernel(onnx.load(str(BUNDLED))))
    np.testing.assert_allclose(ends[1], 1.25 * ends[0], rtol=1e-6)
    np.testing.assert_array_equal(ends[2], first_kernel(other))


def test_a_blend_shifts_scores_and_nothing_else(tmp_path):
    from training.blend import blend

    onnx.save(blend(BUNDLED, BUNDLED, 0.5, score=0.6), str(tmp_path / "shifted.onnx"))
    image = np.random.default_rng(0).integers(0, 256, (1, 128, 128, 3), dtype=np.uint8)
    image = np.repeat(np.repeat(image[:, ::16, ::16], 16, axis=1), 16, axis=2)
    was, now = (
        open_session(path, ("CPUExecutionProvider",), 1).run(None, {"image": image})[0]
        for path in (BUNDLED, tmp_path / "shifted.onnx")
    )
    np.testing.assert_array_equal(now[:, 1:], was[:, 1:])
    at = was[:, 0] > 0.0
    assert at.any()
    # 0.6 becomes 0.3: logit p' = logit p + logit 0.3 − logit 0.6
    odds = was[:, 0][at] / (1.0 - was[:, 0][at]) * (0.3 / 0.7) / (0.6 / 0.4)
    np.testing.assert_allclose(now[:, 0][at], odds / (1.0 + odds), rtol=0.05)  # sigmoids of floats, near 0


def test_files_of_different_networks_are_not_blended(tmp_path):
    from training.blend import blend

    other = onnx.load(str(BUNDLED))
    del other.graph.initializer[-1]
    onnx.save(other, str(tmp_path / "other.onnx"))
    with pytest.raises(ModelError, match="different networks"):
        blend(tmp_path / "other.onnx", BUNDLED, 0.5)
