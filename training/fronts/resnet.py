"""ResNet-18 with the parameter names that torchvision gives it, so that published weights load.

Reference:
    K. He, X. Zhang, S. Ren, J. Sun, "Deep Residual Learning for Image Recognition", arXiv:1512.03385, table 1.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from training.fronts.export import read_weights
from vision.errors import ModelError

WIDTHS = (64, 128, 256, 512)
"""Channels of the four stages, as published."""


class ResidualBlock(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """Two 3 × 3 convolutions and a way past them."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.downsample = None
        if stride > 1:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) → (B, outputs, H / stride, W / stride)."""
        past = x if self.downsample is None else self.downsample(x)
        y = self.bn2(self.conv2(torch.relu(self.bn1(self.conv1(x)))))
        return torch.relu(past + y)


class ResNet18(nn.Module):  # type: ignore[misc]  # torch is not typed here
    """The 18 layers of table 1."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, WIDTHS[0], 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(WIDTHS[0])
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        self.layer1 = nn.Sequential(ResidualBlock(64, 64, 1), ResidualBlock(64, 64, 1))
        self.layer2 = nn.Sequential(ResidualBlock(64, 128, 2), ResidualBlock(128, 128, 1))
        self.layer3 = nn.Sequential(ResidualBlock(128, 256, 2), ResidualBlock(256, 256, 1))
        self.layer4 = nn.Sequential(ResidualBlock(256, 512, 2), ResidualBlock(512, 512, 1))
        self.fc = nn.Linear(512, classes)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def features(self, x: Tensor) -> Tensor:
        """(B, 3, S, S) normalised RGB → (B, 512), what the last layer sees."""
        x = self.maxpool(torch.relu(self.bn1(self.conv1(x))))
        maps: Tensor = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return maps.mean(dim=(2, 3))

    def forward(self, x: Tensor) -> Tensor:
        """(B, 3, S, S) normalised RGB → (B, classes) logits."""
        logits: Tensor = self.fc(self.features(x))
        return logits


def load_weights(net: ResNet18, path: Path) -> bool:
    """Take weights from a torchvision state dict (.pth) or a classifier of ours (.onnx).

    Returns:
        Whether the last layer was taken too; it is left as it is when it has another number of classes.

    Raises:
        ModelError: not the weights of a ResNet-18.
    """
    try:
        if path.suffix == ".onnx":
            state = {name: torch.from_numpy(values) for name, values in read_weights(path).items()}
        else:
            state = torch.load(path, map_location="cpu", weights_only=True)
        known = net.state_dict()
        last = state["fc.weight"].shape == known["fc.weight"].shape
        kept = {name: value for name, value in state.items() if last or not name.startswith("fc.")}
        lacking = [n for n in net.load_state_dict(kept, strict=False).missing_keys if "num_batches" not in n]
        lacking = [n for n in lacking if last or not n.startswith("fc.")]
        if lacking:
            raise KeyError(lacking[0])
    except Exception as error:
        raise ModelError(
            f"{path}: not the weights of a ResNet-18 ({error}); give a torchvision state dict, or an ONNX file that "
            "training.fronts wrote"
        ) from error
    return bool(last)
