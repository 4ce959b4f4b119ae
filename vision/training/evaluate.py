"""Quality of a network on images that it was not trained on."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from vision.detect.decode_heatmap import decode
from vision.detect.detections import Detections
from vision.training.data import TrainingBatch
from vision.training.net import CHANNELS, STRIDE, Net, scores
from vision.training.quality import Quality, measure

__all__ = ["detections_and_truth", "evaluate"]

_LEAST_SCORE = 0.05
"""Score from which boxes are kept: low, so that quality can be measured at any threshold above it."""


def evaluate(net: Net, batch: TrainingBatch) -> Quality:
    """Run a network over a batch and measure it."""
    return measure(*detections_and_truth(net, batch))


def detections_and_truth(
    net: Net, batch: TrainingBatch, chunk: int = 32
) -> tuple[list[Detections], list[NDArray[np.float64]]]:
    """Detections of a network on each image of a batch, ``chunk`` at a time, and the true boxes of each image."""
    net.eval()
    device = next(net.parameters()).device
    found: list[Detections] = []
    with torch.no_grad():
        for start in range(0, len(batch.images), chunk):
            out = net(batch.images[start : start + chunk].to(device).float() / 255.0)
            cells = torch.cat([scores(out), out[:, 1:CHANNELS]], dim=1).cpu().numpy()
            found += [decode(c, STRIDE, _LEAST_SCORE) for c in cells]
    truth = [b[r].astype(np.float64) for b, r in zip(batch.boxes.numpy(), batch.real.numpy(), strict=True)]
    return found, truth
