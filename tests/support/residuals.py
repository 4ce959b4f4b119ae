"""Residuals of pairs of tracks and vehicles, as blocks, and noise levels to weigh them with."""

import numpy as np

from assoc.evidence.blocks import Blocks
from assoc.evidence.likelihood import Noise
from assoc.geometry.ground import THETA

BIAS_STD_M, DECAY, WHITE_VAR = 1.3, 0.9, 0.09


def noise(**changes):
    values = {
        "white_var": WHITE_VAR,
        "bias_std": BIAS_STD_M,
        "decay": DECAY,
        "floor_var": 0.0,
        "pixel_var": 0.0,
        "log_area": np.log(2e3),
        "increment_max": 1e9,
        "in_view_bonus": np.zeros(1),
    }
    return Noise(**(values | changes))


def blocks_of(samples):
    """Blocks of residuals in metres: samples[b][i][j] is (k, 2), for track i and vehicle j."""
    shape = (len(samples), len(samples[0]), len(samples[0][0]))
    count, scatter, mean = np.zeros(shape), np.zeros(shape), np.zeros((*shape, 2))
    for at in np.ndindex(shape):
        r = samples[at[0]][at[1]][at[2]]
        if len(r):
            count[at], mean[at] = len(r), r.mean(axis=0)
            scatter[at] = np.sum((r - r.mean(axis=0)) ** 2)
    return Blocks(
        first=0,
        count=count,
        mean=mean,
        scatter=scatter,
        log_null=np.zeros(shape),
        extra_var=np.zeros(shape),
        jump_var=np.zeros((shape[0], shape[2])),
        pixel_var=np.zeros(shape[:2]),
        jacobian=np.zeros((*shape[:2], 2, THETA)),
        heading=np.zeros(shape[1:]),
        theta=np.zeros(THETA),
    )
