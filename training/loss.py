"""Targets and losses of the detector's map.

Score: the penalty-reduced focal loss of Zhou, Wang, Krähenbühl, "Objects as Points", arXiv:1904.07850, equation 1.
Boxes: learnt at every cell near a centre, as the peak may fall one cell beside it. Judge: learnt at the peaks that the
network itself has, as the cross-entropy with how well the box there overlaps with a label. Of upright labels, whose
angle and sides across and along are unknown, score, centre and judge are learnt; of boxes without a front, all but the
front.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from training.cuts import Known
from training.data import TrainingBatch
from training.net import CHANNELS, STRIDE, scores
from vision.detect.boxes import prob_iou_pairs

WIDTH_SHARE, SIGMA_CELLS = 0.16, (0.5, 2.0)
"""σ of a centre's target across a vehicle: a share of its width, within bounds; a choice."""
CAR_ASPECT, MAX_SPREAD = 2.5, 2.5
"""Vehicles of a higher aspect have targets that spread along them in proportion, this many times σ at most."""
WRONG, RIGHT = 0.45, 0.8
"""Probabilistic overlap with a label up to which a box is wrong, and from which on it is right; in between partly: 0.62
is an intersection over union of about a half."""
NEAR_CENTRE = 0.35
"""Share of a label's length: a centre that is nearer to that of an upright label is right."""
DOUBLE = 0.3
"""Overlap from which a second box on a label is no mistake: the better one suppresses it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """Parts of the loss, each a scalar."""

    score: Tensor
    offset: Tensor
    size: Tensor
    front: Tensor
    axis: Tensor
    judge: Tensor

    def total(self) -> Tensor:
        """Loss that is minimised."""
        return self.score + 2.0 * self.offset + self.size + self.front + self.axis + self.judge


def losses(out: Tensor, batch: TrainingBatch) -> Losses:
    """Compare the map with the labels.

    Args:
        out: (B, CHANNELS + 1, h, w), the network's map.
    """
    _, _, h, w = out.shape
    boxes, real = batch.boxes, batch.real
    centre, side = boxes[..., :2] / STRIDE, boxes[..., 2:4].clamp(min=1.0) / STRIDE
    column = torch.arange(w, device=out.device) + 0.5
    row = torch.arange(h, device=out.device) + 0.5
    # from every cell's middle to every centre, in cells: (B, N, w) and (B, N, h)
    dx, dy = centre[..., :1] - column, centre[..., 1:] - row
    wanted = real & (boxes[..., 5] > 0.5)
    heat, nearest = _heat(dx, dy, side, boxes[..., 4], wanted, batch.known)
    ignored = batch.unjudged | _hidden_cells(dx, dy, side, real & ~wanted)
    score = _focal(out[:, 0], heat, _centre_cells(centre, wanted, h, w), ignored)

    image, r, c = torch.nonzero(heat > 0.3, as_tuple=True)
    k, found, weight = nearest[image, r, c], out[image, :CHANNELS, r, c], heat[image, r, c]
    known = batch.known[image, k]
    offset = torch.stack([dx[image, k, c], dy[image, k, r]], dim=-1)
    heading = boxes[image, k, 4]
    front = torch.stack([heading.sin(), heading.cos()], dim=-1)
    axis = torch.stack([(2.0 * heading).sin(), (2.0 * heading).cos()], dim=-1)

    def mean(error: Tensor, level: Known) -> Tensor:
        share = weight * (known >= int(level))
        return (error.sum(dim=-1) * share).sum() / share.sum().clamp(min=1.0)

    def smooth(found: Tensor, wanted: Tensor, beta: float) -> Tensor:
        return functional.smooth_l1_loss(found, wanted, reduction="none", beta=beta)

    return Losses(
        score=score,
        offset=mean(smooth(found[:, 1:3], offset, 0.1), Known.CENTRE),
        size=mean(smooth(found[:, 3:5], side[image, k].log(), 0.05), Known.BOX),
        front=mean((found[:, 5:7] - front) ** 2, Known.FRONT),
        axis=mean(smooth(found[:, 7:9], axis, 0.1), Known.BOX),
        judge=_judge(out, batch, wanted, ignored),
    )


def _judge(out: Tensor, batch: TrainingBatch, wanted: Tensor, ignored: Tensor) -> Tensor:
    """Cross-entropy of the judge's logit at peaks with how right the box there is, per label that counts."""
    image, r, c = torch.nonzero((scores(out.detach())[:, 0] > 0.0) & ~ignored, as_tuple=True)
    found = out.detach()[image, :CHANNELS, r, c]
    # as vision.detect.decode_heatmap has it: side = e^(log side), angle of the length axis = heading − π/2
    cells = torch.stack([c + 0.5 + found[:, 1], r + 0.5 + found[:, 2]], dim=-1)
    angle = 0.5 * torch.atan2(found[:, 7], found[:, 8]) - 0.5 * torch.pi
    boxes = torch.cat([cells * STRIDE, found[:, 3:5].clamp(-4.0, 6.0).exp() * STRIDE, angle[:, None]], dim=-1)
    right, counted = _rightness(boxes, image, batch, wanted)
    error = functional.binary_cross_entropy_with_logits(out[image, CHANNELS, r, c], right, reduction="none")
    return (error * counted).sum() / wanted.sum().clamp(min=1)


def _rightness(boxes: Tensor, image: Tensor, batch: TrainingBatch, wanted: Tensor) -> tuple[Tensor, Tensor]:
    """Quality of each box (p, 5) of an image, 0 to 1, and whether it counts: (p,) each.

    A label makes one box right, the one that overlaps most with it.
    """
    labels, known, real = batch.boxes[image], batch.known[image], wanted[image]
    far = (boxes[:, None, :2] - labels[..., :2]).norm(dim=-1)
    overlap = torch.zeros_like(far)
    # beyond the sum of their lengths two boxes overlap by less than 0.03
    p, k = torch.nonzero(real & (far < boxes[:, None, 2:4].amax(dim=-1) + labels[..., 2]), as_tuple=True)
    axes = torch.cat([labels[p, k, :4], labels[p, k, 4:5] - 0.5 * torch.pi], dim=-1)
    pairs = prob_iou_pairs(boxes[p].double().cpu().numpy(), axes.double().cpu().numpy())
    overlap[p, k] = torch.from_numpy(pairs.astype(np.float32)).to(boxes.device)
    overlap = torch.where(known == int(Known.CENTRE), (far < NEAR_CENTRE * labels[..., 2]).float(), overlap)
    overlap = torch.where(real, overlap, 0.0)
    # of boxes that are as good, the one whose centre is nearer
    nearness = overlap - 1e-4 * torch.where(real, far, 0.0)
    most, label = overlap.max(dim=1)
    best = torch.full((len(wanted), wanted.shape[1]), -torch.inf, device=boxes.device)
    place = image * wanted.shape[1] + label
    own = nearness.gather(1, label[:, None])[:, 0]
    best = best.flatten().scatter_reduce(0, place, own, "amax")
    first = own >= best[place]
    right = ((most - WRONG) / (RIGHT - WRONG)).clamp(0.0, 1.0) * first
    return right, first | (most < DOUBLE)


def _heat(
    dx: Tensor, dy: Tensor, side: Tensor, heading: Tensor, wanted: Tensor, known: Tensor
) -> tuple[Tensor, Tensor]:
    """Closeness of each cell to a centre, 1 in it, and which centre that is: two of (B, h, w).

    σ grows with the width, as a cell well inside a large vehicle is a small mistake, and along a vehicle that is longer
    than a car also with its length: where between its ends the middle of a bus lies is seen less sharply than where
    between its sides.
    """
    aspect = side[..., 0] / side[..., 1]
    across = (WIDTH_SHARE * side[..., 1].minimum(side[..., 0])).clamp(*SIGMA_CELLS)
    along = across * torch.where(known >= int(Known.BOX), aspect / CAR_ASPECT, 1.0).clamp(1.0, MAX_SPREAD)
    sin, cos = heading.sin()[..., None, None], heading.cos()[..., None, None]
    x, y = dx[..., None, :], dy[..., :, None]
    # exp(−a² / 2σ_a² − c² / 2σ_c²), a along and c across the vehicle, whose front points to (sin, −cos)
    a, c = (x * sin - y * cos) / along[..., None, None], (x * cos + y * sin) / across[..., None, None]
    heat, nearest = (torch.exp(-0.5 * (a * a + c * c)) * wanted[..., None, None]).max(dim=1)
    return heat, nearest


def _centre_cells(centre: Tensor, wanted: Tensor, h: int, w: int) -> Tensor:
    """(B, h, w) True in the cells that hold a centre."""
    cells = torch.zeros((len(centre), h, w), dtype=torch.bool, device=centre.device)
    image, k = torch.nonzero(wanted, as_tuple=True)
    column, row = centre[image, k].long().unbind(dim=-1)
    cells[image, row.clamp(0, h - 1), column.clamp(0, w - 1)] = True
    return cells


def _hidden_cells(dx: Tensor, dy: Tensor, side: Tensor, hidden: Tensor) -> Tensor:
    """(B, h, w) True around vehicles that are mostly hidden: found or not, neither is a mistake."""
    near = dy[..., :, None] ** 2 + dx[..., None, :] ** 2 < (0.5 * side[..., 0, None, None]) ** 2
    return (near & hidden[..., None, None]).any(dim=1)


def _focal(logit: Tensor, heat: Tensor, positive: Tensor, ignored: Tensor) -> Tensor:
    """−(1 − p)² log p at centres, −(1 − heat)⁴ p² log(1 − p) elsewhere, per centre."""
    p = torch.sigmoid(logit)
    at = torch.where(positive, (1.0 - p) ** 2 * functional.softplus(-logit), 0.0)
    elsewhere = torch.where(positive | ignored, 0.0, (1.0 - heat) ** 4 * p**2 * functional.softplus(logit))
    return (at.sum() + elsewhere.sum()) / positive.sum().clamp(min=1)
