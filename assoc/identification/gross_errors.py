"""When gross errors of the camera's pose and clock are searched: at the start, and while nothing fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assoc.hypotheses.pose import PosePrior
from assoc.identification.fleet_fit import FleetFit

__all__ = ["GrossErrors"]

FloatArray = NDArray[np.float64]

_ROUNDS = 2
"""How often each is tried while film and telemetry fit, but not clearly: an offset shows only once vehicles moved."""


class GrossErrors:
    """Starts at the rare parts of the prior: all at once in the first update, then one an update in turn."""

    def __init__(self) -> None:
        self._tried = 0

    def starts(self, prior: PosePrior, fit: FleetFit, *, at_once: bool) -> list[FloatArray]:
        """(8,) each, where this update also starts.

        Args:
            prior: Of this update.
            fit: Whether film and telemetry fitted until now.
            at_once: Whether all may be tried in one update.
        """
        parts = prior.others
        settled = fit.clear or (fit.fits and self._tried >= _ROUNDS * len(parts))
        if not parts or (self._tried and settled):
            return []
        first = self._tried % len(parts)
        chosen = parts if at_once and not self._tried else parts[first : first + 1]
        self._tried += len(chosen)
        return [part.mean.copy() for part in chosen]
