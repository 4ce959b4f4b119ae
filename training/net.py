"""The network: small, anchor-free, fully convolutional; one map at stride 4 holds what is centred in each cell.

Nine channels: score logit; centre offset x, y in cells from the cell's middle; log length and log width in cells; front
as (sin, cos) of the heading clockwise from image up; axis as (sin, cos) of twice the heading. The axis is the same for
both directions of travel, so a vehicle whose front is uncertain keeps a sharp box, and the front vector's length gives
how sure the front is: under squared error, a front that is right with probability p has length 2p − 1.

A tenth channel, of the judge: how likely a box that is centred in the cell is right, as a logit. Where the middle of a
bus lies, or of a vehicle half behind a tree, is hard to tell, so the first channel is low on it however surely
something is there; the judge is asked only of the peaks of the first, and learns from what the network itself finds.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

STRIDE = 4
"""Pixels of the input for each cell of the map, on a side."""
CHANNELS = 9
"""Channels of the map, as ``vision.detect.decode_heatmap`` reads it; the judge's comes after them while training."""
JUDGED = 0.02
"""Least peak of the first channel that is judged: weaker ones are no detections, whatever the judge says."""


class ConvNorm(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """Convolution, batch norm, and ReLU unless switched off."""

    def __init__(self, inputs: int, outputs: int, *, size: int = 3, stride: int = 1, relu: bool = True) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
        self.norm = nn.BatchNorm2d(outputs)
        self.relu = relu

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) → (B, outputs, H / stride, W / stride)."""
        y: Tensor = self.norm(self.conv(x))
        return torch.relu(y) if self.relu else y


class Residual(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """x + two convolutions of x, then ReLU; begins as no more than the ReLU."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = ConvNorm(channels, channels)
        self.second = ConvNorm(channels, channels, relu=False)
        nn.init.zeros_(self.second.norm.weight)

    def forward(self, x: Tensor) -> Tensor:
        """Shape is kept."""
        return torch.relu(x + self.second(self.first(x)))


class Grow(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """Twice the size: a 1 × 1 convolution to four values per channel, which become a square of 2 × 2.

    So the finer map knows which of the four a cell is. W. Shi et al., arXiv:1609.05158; begins as plain repetition.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.spread = ConvNorm(inputs, 4 * outputs, size=1, relu=False)
        with torch.no_grad():
            kernel = self.spread.conv.weight
            kernel.copy_(kernel[::4].repeat_interleave(4, dim=0))

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) → (B, outputs, 2 H, 2 W)."""
        return nn.functional.pixel_shuffle(self.spread(x), 2)


class Judge(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """From what the network has at strides 16, 8 and 4 to a logit that is added to that of the score; begins as 0."""

    def __init__(self) -> None:
        super().__init__()
        self.deep_side = Grow(80, 32)
        self.join_side = ConvNorm(48, 32, size=1, relu=False)
        self.middle_side = Grow(32, 16)
        self.last_side = ConvNorm(32, 16, size=1, relu=False)
        self.verdict = nn.Conv2d(16, 1, 1)
        nn.init.zeros_(self.verdict.weight)
        nn.init.zeros_(self.verdict.bias)

    def forward(self, sixteenth: Tensor, eighth: Tensor, quarter: Tensor) -> Tensor:
        """(B, 80, h / 4, w / 4), (B, 48, h / 2, w / 2), (B, 32, h, w) → (B, 1, h, w)."""
        eighth = torch.relu(self.deep_side(sixteenth) + self.join_side(eighth))
        out: Tensor = self.verdict(torch.relu(self.middle_side(eighth) + self.last_side(quarter)))
        return out


class Net(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """Down to stride 32, and up again to stride 4 with skips."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(ConvNorm(3, 16, stride=2), ConvNorm(16, 24, stride=2))
        self.middle = nn.Sequential(ConvNorm(24, 48, stride=2), Residual(48))
        self.deep = nn.Sequential(ConvNorm(48, 80, stride=2), Residual(80), Residual(80), Residual(80))
        self.wide = nn.Sequential(ConvNorm(80, 112, stride=2), Residual(112), Residual(112))
        self.wide_side = Grow(112, 80)
        nn.init.zeros_(self.wide_side.spread.norm.weight)
        self.deep_side = Grow(80, 48)
        self.join = nn.Sequential(ConvNorm(48, 48), Residual(48))
        self.join_side = Grow(48, 32)
        self.stem_side = ConvNorm(24, 32, size=1, relu=False)
        self.last = nn.Sequential(ConvNorm(32, 32), Residual(32))
        self.head = nn.Conv2d(32, CHANNELS, 1)
        # log-odds of a cell to hold a centre before anything is known
        nn.init.constant_(self.head.bias[:1], -4.6)
        self.judge = Judge()

    def forward(self, image: Tensor) -> Tensor:
        """(B, 3, H, W) BGR in 0..1, sides multiples of 32 → (B, CHANNELS + 1, H / 4, W / 4)."""
        quarter = self.stem(image)
        eighth = self.middle(quarter)
        sixteenth = self.deep(eighth)
        sixteenth = torch.relu(sixteenth + self.wide_side(self.wide(sixteenth)))
        eighth = self.join(torch.relu(eighth + self.deep_side(sixteenth)))
        quarter = self.last(torch.relu(self.stem_side(quarter) + self.join_side(eighth)))
        out = self.head(quarter)
        # what the judge learns of a cell must not move its centres
        return torch.cat([out, out[:, :1].detach() + self.judge(sixteenth, eighth, quarter)], dim=1)


def scores(out: Tensor) -> Tensor:
    """Scores (B, 1, h, w) of the map (B, CHANNELS + 1, h, w) of a ``Net``: the judge's 0..1 at peaks, 0 elsewhere."""
    centre = torch.sigmoid(out[:, :1])
    peak = (nn.functional.max_pool2d(centre, 3, 1, 1) == centre) & (centre >= JUDGED)
    return torch.sigmoid(out[:, CHANNELS:]) * peak
