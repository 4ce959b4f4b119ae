"""Receivers whose errors wander so fast that only where vehicles are tells who is who, not how they got there.

The course of a pair's residuals is compared with what reports and boxes foresee, each by its own past
(:mod:`assoc.evidence.likelihood`). An error that goes round in ten seconds is foreseen by the reports' past and by no
box, so that all right pairs lose with every second, though every box stays where its vehicle reports to be. While film
and telemetry do not fit by course, places alone are tried beside it; once these are used, courses are.

Another fleet in the same formation is at the right places too, for as long as it drives like ours; what it is off by
drifts and grows. So places alone name nobody unless the residuals r of the pairs are seen to wander to and fro,

    Σ r(t)·r(t + 4 s) < −½ √(Σ |r(t)|² Σ |r(t + 4 s)|²).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from assoc.geometry.ground import THETA
from assoc.hypotheses.search import Hypothesis, UpdateContext, refine
from assoc.identification.fleet_fit import FleetFit
from assoc.records import CameraState

_HOLDS_S = 3.0
"""Time for which the other comparison has to fit before names are given by it, seconds."""
_LATER_BLOCKS, _MIN_PRODUCTS, _TURNED = 4, 20, -0.5
"""Blocks from a residual to the one it is compared with, the least number of such products that tell anything, and the
correlation below which errors wander to and fro: −0.8 with periods of 7 to 13 s, of other fleets −0.35 at least."""


class OtherErrors:
    """The comparison that names are not given by: whether film and telemetry fit by it.

    Args:
        by_place: It is by place alone; False: by the course of the residuals.
    """

    def __init__(self, *, by_place: bool) -> None:
        self._by_place = by_place
        self._fit = FleetFit(proves=not by_place)
        self._theta = np.zeros(THETA)
        self._since_s = np.inf
        self._fast: bool | None = None
        self.found = False
        """True if names are to be given by it: film and telemetry have fitted by it for seconds."""

    @property
    def may_fit(self) -> bool:
        """True if film and telemetry fit by it, and nothing shows yet that this is by chance."""
        return self._fit.fits and not (self._by_place and self._fast is False)

    def look(self, t: float, context: UpdateContext, camera: CameraState) -> None:
        """Compare film and telemetry by it.

        Args:
            t: Time, seconds.
            context: What the update worked on, with the noise of this comparison.
            camera: The newest frame's.
        """
        other = replace(context.without_memory(), handover=np.zeros_like(context.handover))
        starts = (self._theta, np.zeros(THETA))
        found = max((refine(other, theta) for theta in starts), key=lambda hypothesis: hypothesis.value)
        self._theta = found.theta
        self._fit.update(t, other, found, steady=camera.attitude_known and camera.stabilized)
        self._since_s = min(self._since_s, t) if self._fit.fits else np.inf
        self._fast = _wander_fast(found)
        self.found = t - self._since_s >= _HOLDS_S and (not self._by_place or self._fast is True)


def _wander_fast(best: Hypothesis) -> bool | None:
    """Tell whether the pairs' residuals have turned round some seconds later; None while there are too few."""
    rows = np.flatnonzero(best.vehicle >= 0)
    blocks, pairs = best.blocks, (slice(None), rows, best.vehicle[rows])
    r = blocks.mean[pairs] + blocks.jacobian[:, rows] @ (best.theta - blocks.theta)
    compared = blocks.count[pairs] > 0.0
    both = compared[:-_LATER_BLOCKS] & compared[_LATER_BLOCKS:]
    if np.sum(both) < _MIN_PRODUCTS:
        return None
    early, late = r[:-_LATER_BLOCKS][both], r[_LATER_BLOCKS:][both]
    return bool(np.sum(early * late) < _TURNED * math.sqrt(np.sum(early**2) * np.sum(late**2)))
