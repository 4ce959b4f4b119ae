"""The true world of a scenario at any time: bodies, UAV, camera. Nothing in it is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.camera import view_from
from sim.cast import Cast, Roles, play
from sim.flight import UavMotion, UavTruth, fly
from sim.motion import time_grid
from sim.scenario import Occlusion, Scenario
from sim.view import OCCLUDER, Bodies, CameraView, Scene

__all__ = ["LEAD_S", "TAIL_S", "World", "WorldState", "random_stream"]

FloatArray = NDArray[np.float64]

LEAD_S, TAIL_S = 5.0, 2.0
"""How long the world exists before the first and after the last frame."""

CANOPY_COLOR = (40, 80, 45)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldState:
    """The truth at one instant; the n bodies in the order of ``World.roles``."""

    t: float
    """Seconds since the first frame."""
    xy: FloatArray
    """(n, 2) ENU metres; bodies stand on z = 0."""
    v_enu: FloatArray
    """(n, 3) m/s."""
    heading: FloatArray
    """(n,) of the nose, radians clockwise from north, not wrapped."""
    speed: FloatArray
    """(n,) along the nose, m/s, negative in reverse."""
    uav: UavTruth


class World:
    """Generated once from the scenario's seed; looking up changes nothing."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        t = time_grid(-LEAD_S, scenario.duration_s + TAIL_S)
        self._cast: Cast = play(scenario, t, random_stream(scenario, "cast"))
        self._flight = self._fly(t)
        self._canopies = self._place_canopies()

    @property
    def roles(self) -> Roles:
        """Who the n bodies are; the first ``scenario.fleet_size`` are ours."""
        return self._cast.roles

    @property
    def scene(self) -> Scene:
        """The roads."""
        return self._cast.scene

    def at(self, t: float) -> WorldState:
        """The truth t seconds after the first frame; held beyond the ends of the simulated time."""
        xy, heading, speed = self._cast.motion.at(t)
        before, after = self._cast.motion.at(t - 0.05)[0], self._cast.motion.at(t + 0.05)[0]
        v = np.concatenate([(after - before) / 0.1, np.zeros((len(xy), 1))], axis=1)
        return WorldState(t=t, xy=xy, v_enu=v, heading=heading, speed=speed, uav=self._flight.at(t))

    def at_uav(self, t: FloatArray) -> UavTruth:
        """The UAV at times t (k,)."""
        return self._flight.at(t)

    def track_of(self, body: int, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One body at times t (k,): position (k, 2), velocity (k, 2), heading (k,)."""
        motion = self._cast.motion.only(body)
        xy, heading, _ = motion.at(t)
        v = (motion.at(t + 0.05)[0] - motion.at(t - 0.05)[0]) / 0.1
        return xy[:, 0], v[:, 0], heading[:, 0]

    def view(self, t: float) -> CameraView:
        """The true camera."""
        return view_from(self.scenario, self._flight.at(t))

    def bodies(self, t: float) -> Bodies:
        """All n bodies in the order of ``roles``, then the occluders."""
        state, roles, canopies = self.at(t), self.roles, self._canopies
        size = np.concatenate([roles.size, canopies[:, 3:6]])
        return Bodies(
            kind=np.concatenate([roles.kind, np.full(len(canopies), OCCLUDER, dtype=np.int8)]),
            x=np.concatenate([state.xy[:, 0], canopies[:, 0]]),
            y=np.concatenate([state.xy[:, 1], canopies[:, 1]]),
            heading=np.concatenate([state.heading, canopies[:, 2]]),
            length=size[:, 0],
            width=size[:, 1],
            height=size[:, 2],
            color=np.concatenate([roles.color, np.full((len(canopies), 3), CANOPY_COLOR, dtype=np.uint8)]),
        )

    def _fly(self, t: FloatArray) -> UavMotion:
        scenario = self.scenario
        if scenario.ground.kind in ("open", "parked"):
            filmed = np.zeros((len(t), 1, 2))
        else:
            filmed = self._cast.motion.xy[:, : scenario.ground.vehicles]
        return fly(t, filmed, scenario.flight, scenario.camera, random_stream(scenario, "flight"))

    def _place_canopies(self) -> FloatArray:
        """(k, 6) x, y, heading, length, width, height."""
        rows = [self._canopy(occlusion) for occlusion in self.scenario.occlusions]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 6)

    def _canopy(self, occlusion: Occlusion) -> tuple[float, ...]:
        state = self.at(occlusion.t_s)
        i = occlusion.vehicle
        roof = 0.5 * float(self.roles.size[i, 2])
        # the canopy's middle lies on the line of sight: p + (c − p) (h − z) / (H − z)
        part = (occlusion.height_m - roof) / (float(state.uav.p_enu[2]) - roof)
        middle = state.xy[i] + (state.uav.p_enu[:2] - state.xy[i]) * part
        length = max(abs(float(state.speed[i])) * occlusion.duration_s, float(self.roles.size[i, 0]) + 1.0)
        return (*middle.tolist(), float(state.heading[i]), length, occlusion.width_m, occlusion.height_m)


def random_stream(scenario: Scenario, purpose: str) -> np.random.Generator:
    """A generator of its own for each purpose, so that a change to one part leaves the others' draws alone."""
    return np.random.default_rng([scenario.seed, *purpose.encode()])
