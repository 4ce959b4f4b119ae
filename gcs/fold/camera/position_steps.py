"""Steps in the UAV's reported position that no aircraft can do, taken out of the image's pose while names are sure.

A receiver that glitches moves the reported camera and not the image. To go on from where the image was keeps names
right through a glitch and its end. Where names are not sure the new place is as good as the old, and the evidence is
forgotten.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_STEP_M, _REST_M, _ACCELERATION = 6.0, 1.0, 12.0
"""Least step, metres, as filters settle in steps of a few; least rest of one that follows at once; and acceleration a,
m/s²: an aircraft leaves its straight line by ½ a t² in the time looked back."""
_BACK_US, _LONGEST_US = 300_000, 1_500_000
"""Time looked back, as positions between reports are interpolated and a step may be spread over some frames; and the
longest gap between two frames that are compared."""
_PATIENCE_US = 8_000_000
"""Time for which a step stays taken out while names are not sure; after it the new place was the true one."""


class StepFilter:
    """The UAV's steps, frame by frame.

    Attributes:
        shift_enu: (3,) metres to add to the reported position, its height excepted.
    """

    def __init__(self) -> None:
        self.shift_enu: FloatArray = np.zeros(3)
        self._past: deque[tuple[int, FloatArray]] = deque()
        self._unsure_us, self._stepped_us = 0, -_LONGEST_US

    def update(self, t_us: int, p_enu: FloatArray, v_enu: FloatArray, *, sure: bool) -> float:
        """Take in where the UAV is reported in a frame.

        Args:
            t_us: its time.
            p_enu: (3,) the UAV as reported, NaN unknown.
            v_enu: (3,) its velocity.
            sure: whether the names are.

        Returns:
            Metres of a step after which names have to start again, 0 where there was none or it was taken out.
        """
        if not np.isfinite(p_enu).all():
            return 0.0
        if self._past and not 0 <= t_us - self._past[-1][0] <= _LONGEST_US:
            self._past.clear()
            if self.shift_enu.any():  # it may have stepped back in the hole
                return self._restart_from_report(t_us, p_enu, self.shift_enu)
        while self._past and not 0 <= t_us - self._past[0][0] <= _LONGEST_US:
            self._past.popleft()
        while len(self._past) > 1 and t_us - self._past[1][0] >= _BACK_US:
            self._past.popleft()
        step = self._step(t_us, p_enu, v_enu)
        self._past.append((t_us, p_enu))
        self._unsure_us = 0 if sure or not self.shift_enu.any() else self._unsure_us or t_us
        late = bool(self._unsure_us) and t_us - self._unsure_us > _PATIENCE_US
        if not step.any() and not late:
            return 0.0
        if step.any() and (sure or self.shift_enu.any()) and not late:
            self._go_on_from(t_us, p_enu)
            self.shift_enu = self.shift_enu - step
            return 0.0
        return self._restart_from_report(t_us, p_enu, step - self.shift_enu)

    def _restart_from_report(self, t_us: int, p_enu: FloatArray, step: FloatArray) -> float:
        """Start from the reported position; return how far, in metres, that is from where the image was taken to be."""
        self._go_on_from(t_us, p_enu)
        self.shift_enu, self._unsure_us = np.zeros(3), 0
        return float(np.hypot(step[0], step[1]))

    def _go_on_from(self, t_us: int, p_enu: FloatArray) -> None:
        self._stepped_us = t_us
        self._past.clear()
        self._past.append((t_us, p_enu))

    def _step(self, t_us: int, p_enu: FloatArray, v_enu: FloatArray) -> FloatArray:
        """(3,) how far it is from where it would be by its velocity, level; 0 where it may be there."""
        if not self._past:
            return np.zeros(3)
        before_us, before = self._past[0]
        dt = (t_us - before_us) * 1e-6
        step = p_enu - before - np.where(np.isfinite(v_enu), v_enu, 0.0) * dt
        step[2] = 0.0
        least_m = _REST_M if t_us - self._stepped_us <= _BACK_US else _STEP_M
        return step if np.hypot(step[0], step[1]) > least_m + 0.5 * _ACCELERATION * dt * dt else np.zeros(3)
