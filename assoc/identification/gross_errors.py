"""Search for gross errors of the camera's pose and clock: at the start, and while nothing fits.

A mirrored picture is one of them, but no value of θ: with F = diag(−1, 1, 1) each ray d is really F d, which is the
same as a camera of rotation R F. It is tried while nothing fits, as a second camera with the same prior of θ.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from assoc.geometry.ground import THETA, YAW
from assoc.hypotheses.pose import PosePrior
from assoc.hypotheses.search import UpdateContext, refine
from assoc.identification.fleet_fit import FleetFit, evidence_of
from assoc.records import CameraState

FloatArray = NDArray[np.float64]

_ROUNDS = 2
"""Number of times that each is tried while film and telemetry fit, but not clearly: an offset shows only once vehicles
moved."""
MIRROR: FloatArray = np.array([-1.0, 1.0, 1.0])
"""Factor on the columns of a camera's rotation, R F: left and right of its picture are exchanged."""
_MIRRORED_LOG_SHARE = float(np.log(1e-3))
"""ln share of mirrored pictures in the prior: as rare as the other gross errors."""
_MIRROR_EVERY = 3
"""Updates from one look at the mirrored picture to the next, while nothing fits: it takes two searches more."""
_MIRRORED_TURNS = (0.0, float(np.pi))
"""Headings a mirrored picture is tried with, radians: upside down it is mirrored and turned."""


class GrossErrors:
    """Starts at the rare parts of the prior: all at once in the first update, then one an update in turn."""

    def __init__(self) -> None:
        self._tried = 0
        self._misfits = 0
        self.mirror_found = False
        """True if left and right of the picture proved to be the other way round."""

    def starts(self, prior: PosePrior, fit: FleetFit, *, at_once: bool) -> list[FloatArray]:
        """(9,) each, where this update also starts.

        Args:
            prior: Of this update.
            fit: Whether film and telemetry fitted until now.
            at_once: Whether all may be tried in one update.
        """
        always = [] if fit.clear else [part.mean.copy() for part in prior.others if part.at_once]
        parts = [part for part in prior.others if not part.at_once]
        settled = fit.clear or (fit.fits and self._tried >= _ROUNDS * len(parts))
        if not parts or (self._tried and settled):
            return always
        first = self._tried % len(parts)
        chosen = parts if at_once and not self._tried else parts[first : first + 1]
        self._tried += len(chosen)
        return [*always, *(part.mean.copy() for part in chosen)]

    def look_mirrored(self, context: UpdateContext, fit: FleetFit, camera: CameraState) -> None:
        """Look at the mirrored picture now and then; for each update in which film and telemetry do not fit.

        Args:
            context: What the update works on.
            fit: Whether film and telemetry fit as they are.
            camera: The newest frame's.
        """
        self._misfits += 1
        # the boxes of a camera that shakes went into its attitude already, the wrong way round
        tried = camera.attitude_known and camera.stabilized and self._misfits % _MIRROR_EVERY == 0
        self.mirror_found = tried and _is_mirrored(context, fit)


def _is_mirrored(context: UpdateContext, fit: FleetFit) -> bool:
    """Tell whether reports and boxes agree in the mirrored picture, clearly and far better than in this one.

    Args:
        context: What the update works on.
        fit: Whether film and telemetry fit as they are.
    """
    history = copy(context.history)
    history.R, history.R_reported = history.R * MIRROR, history.R_reported * MIRROR
    mirrored = replace(context.without_memory(), history=history, handover=np.zeros_like(context.handover))
    starts = np.zeros((len(_MIRRORED_TURNS), THETA))
    starts[:, YAW] = _MIRRORED_TURNS
    best = max((refine(mirrored, theta) for theta in starts), key=lambda hypothesis: hypothesis.value)
    return fit.is_surpassed(mirrored, best, evidence_of(mirrored, best).course, _MIRRORED_LOG_SHARE)
