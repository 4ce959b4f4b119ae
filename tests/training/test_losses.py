"""What training learns from each kind of label, and that it begins with the bundled network as it is; needs torch."""

from __future__ import annotations

import numpy as np
import pytest

from training.cuts import Known, TrainingSample
from vision.detect.detector import BUNDLED
from vision.detect.onnx_model import open_session
from vision.errors import ModelError

torch = pytest.importorskip("torch", reason="needs the extra 'train'")
pytest.importorskip("onnx", reason="needs the extra 'train'")

SCORE, OFFSET, BOX, FRONT, JUDGE = slice(0, 1), slice(1, 3), [3, 4, 7, 8], slice(5, 7), 9
"""Channels of the network's map."""


def batch_of(known, unjudged=()):
    from training.data import batch_samples

    boxes = np.array([[128.0, 128.0, 52.0, 24.0, 0.7, 1.0]], np.float32)
    sample = TrainingSample(
        image=np.zeros((256, 256, 3), np.uint8),
        boxes=boxes,
        known=np.array([int(known)]),
        unjudged=np.array(unjudged, np.float32).reshape(-1, 4, 2),
    )
    return batch_samples([sample], np.random.default_rng(0))


def gradients(batch):
    from training.loss import losses

    out = torch.zeros((1, 10, 64, 64), requires_grad=True)
    losses(out, batch).total().backward()
    return out.grad[0].abs()


@pytest.mark.parametrize(
    ("known", "box", "front"), [(Known.CENTRE, False, False), (Known.BOX, True, False), (Known.FRONT, True, True)]
)
def test_a_label_teaches_what_it_knows_and_no_more(known, box, front):
    slope = gradients(batch_of(known))
    assert slope[SCORE].max() > 0.0
    assert slope[OFFSET].max() > 0.0
    assert (slope[BOX].amax(dim=(1, 2)) > 0.0).tolist() == [box] * 4
    assert (slope[FRONT].amax(dim=(1, 2)) > 0.0).tolist() == [front] * 2


@pytest.mark.parametrize(("length", "spread"), [(52.0, False), (150.0, True)])
def test_a_guess_beside_the_middle_costs_less_along_a_bus_than_across_it(length, spread):
    from training.loss import losses

    batch = batch_of(Known.FRONT)
    batch.boxes[0, 0] = torch.tensor([128.0, 128.0, length, 24.0, 0.0, 1.0])
    cost = []
    for row, column in ((28, 32), (32, 36)):
        out = torch.full((1, 10, 64, 64), -8.0)
        out[0, 0, row, column] = 4.0
        cost.append(float(losses(out, batch).score))
    assert (cost[0] < 0.8 * cost[1]) == spread


def map_with_boxes(*cells, length=52.0, width=24.0):
    """A map (1, 10, 64, 64) with a box of heading 0.7 at each (row, column)."""
    out = torch.full((1, 10, 64, 64), -8.0)
    for row, column in cells:
        out[0, :, row, column] = torch.tensor(
            [2.0, 0.0, 0.0, np.log(length / 4), np.log(width / 4), 0.0, 0.0, np.sin(1.4), np.cos(1.4), 0.0]
        )
    return out.requires_grad_()


def judged(batch, out):
    """(64, 64) slope of the loss by the judge's logit: below 0 where a box is right, above where it is wrong."""
    from training.loss import losses

    losses(out, batch).judge.backward()
    assert not out.grad[0, :JUDGE].any()
    return out.grad[0, JUDGE]


@pytest.mark.parametrize("known", [Known.BOX, Known.CENTRE])
def test_the_judge_learns_at_peaks_which_boxes_are_right(known):
    slope = judged(batch_of(known), map_with_boxes((32, 32), (10, 10)))
    assert slope[32, 32] < 0.0 < slope[10, 10]
    slope[[32, 10], [32, 10]] = 0.0
    assert not slope.any()


def test_a_box_that_is_much_too_long_is_wrong():
    assert judged(batch_of(Known.BOX), map_with_boxes((32, 32), length=150.0))[32, 32] > 0.0


def test_the_worse_of_two_boxes_on_a_vehicle_teaches_the_judge_nothing():
    slope = judged(batch_of(Known.BOX), map_with_boxes((32, 32), (30, 33)))
    assert slope[32, 32] < 0.0 == slope[30, 33]


def test_the_judge_learns_nothing_from_what_is_hidden_or_was_not_judged():
    batch = batch_of(Known.BOX, [[(8.0, 8.0), (56.0, 8.0), (56.0, 56.0), (8.0, 56.0)]])
    batch.boxes[..., 5] = 0.3
    assert not judged(batch, map_with_boxes((32, 32), (10, 10))).any()


def test_nothing_is_a_mistake_where_nothing_was_judged():
    area = [[(8.0, 8.0), (56.0, 8.0), (56.0, 40.0), (8.0, 40.0)]]
    free, masked = gradients(batch_of(Known.FRONT))[0], gradients(batch_of(Known.FRONT, area))[0]
    assert free[2:10, 2:14].min() > 0.0
    assert masked[2:10, 2:14].max() == 0.0
    assert torch.equal(free[20:], masked[20:])


def test_training_begins_with_what_the_bundled_file_computes():
    from training.export import read_weights, restore_statistics
    from training.net import Net, scores

    images = np.random.default_rng(0).integers(0, 256, (4, 128, 128, 3), np.uint8)
    session = open_session(BUNDLED, ("CPUExecutionProvider",), 1)
    wanted = np.stack([session.run(None, {"image": image[None]})[0][0] for image in images])
    net = Net()
    read_weights(net, BUNDLED)
    pixels = torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255.0
    for restored in (False, True):
        if restored:
            restore_statistics(net, pixels)
        with torch.no_grad():
            out = net.eval()(pixels)
            assert np.allclose(out[:, 1:9].numpy(), wanted[:, 1:], atol=1e-3)
            assert np.allclose(scores(out).numpy(), wanted[:, :1], atol=1e-3)
    # and in training, when norms take the statistics of what they see
    with torch.no_grad():
        assert np.allclose(net.train()(pixels)[:, 1:9].numpy(), wanted[:, 1:], atol=0.05)


def test_another_network_is_refused(tmp_path):
    from training.export import read_weights
    from training.net import Net

    with pytest.raises(ModelError, match="of another network"):
        read_weights(Net(), BUNDLED.with_name("rollcall-front-resnet18.onnx"))
    (tmp_path / "text.onnx").write_text("no model")
    with pytest.raises(ModelError, match=r"text\.onnx"):
        read_weights(Net(), tmp_path / "text.onnx")
