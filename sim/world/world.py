"""The true world of a scenario at any time: bodies, UAV, camera. Nothing in it is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.world.actors import Actors, Roles, simulate_actors
from sim.world.camera import view_from
from sim.world.flight import UavMotion, UavTruth, fly
from sim.world.motion import time_grid
from sim.world.scenario import Occlusion, Scenario
from sim.world.view import OCCLUDER, Bodies, CameraView, Scene

FloatArray = NDArray[np.float64]

LEAD_S, TAIL_S = 5.0, 2.0
"""Time for which the world exists before the first and after the last frame."""

CANOPY_COLOR = (40, 80, 45)
"""BGR of tree crowns, a dark green; a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldState:
    """The truth at one instant; the n bodies in the order of ``World.roles``."""

    t: float
    """Seconds since the first frame."""
    xy: FloatArray
    """(n, 2) east and north metres on the ground, which is z = 0 unless it slopes or is wavy."""
    v_enu: FloatArray
    """(n, 3) m/s."""
    heading: FloatArray
    """(n,) of the nose, radians clockwise from north, not wrapped."""
    speed: FloatArray
    """(n,) along the nose, m/s, negative in reverse."""
    uav: UavTruth


class World:
    """Generated once from the scenario's seed; looking up changes nothing.

    Args:
        actors: bodies whose motion is known, in place of generated ones; the first ``scenario.fleet_size`` are ours.
        flight: the UAV's known motion, in place of a generated one.
    """

    def __init__(self, scenario: Scenario, *, actors: Actors | None = None, flight: UavMotion | None = None) -> None:
        self.scenario = scenario
        t = time_grid(-LEAD_S, scenario.duration_s + TAIL_S)
        self._actors: Actors = actors or simulate_actors(scenario, t, random_stream(scenario, "cast"))
        self._flight = flight or self._fly(t)
        self._R_enu_ground = _sloping(scenario)
        self._canopies = self._place_canopies()

    def seen_from(self, number: int) -> World:
        """Return the world with the aircraft and camera of that number, from 2 on, over the same ground."""
        world = World(self.scenario.of_view(number), actors=self._actors)
        values = world._flight.values.copy()
        values[:, :2] += self.scenario.views[number - 2].aside_m
        world._flight, world._canopies = replace(world._flight, values=values), self._canopies
        return world

    @property
    def views(self) -> list[World]:
        """Worlds of all further cameras."""
        return [self.seen_from(number + 2) for number in range(len(self.scenario.views))]

    @property
    def roles(self) -> Roles:
        """Identities of the n bodies; the first ``scenario.fleet_size`` are ours."""
        return self._actors.roles

    @property
    def scene(self) -> Scene:
        """The roads."""
        return self._actors.scene

    def at(self, t: float) -> WorldState:
        """The truth t seconds after the first frame; held beyond the ends of the simulated time."""
        xy, heading, speed = self._actors.motion.at(t)
        before, after = self._actors.motion.at(t - 0.05)[0], self._actors.motion.at(t + 0.05)[0]
        v = np.concatenate([(after - before) / 0.1, np.zeros((len(xy), 1))], axis=1)
        return WorldState(t=t, xy=xy, v_enu=v, heading=heading, speed=speed, uav=self._flight.at(t))

    def at_uav(self, t: FloatArray) -> UavTruth:
        """The UAV at times t (k,)."""
        return self._flight.at(t)

    def track_of(self, body: int, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One body at times t (k,): position (k, 2), velocity (k, 2), heading (k,)."""
        motion = self._actors.motion.only(body)
        xy, heading, _ = motion.at(t)
        v = (motion.at(t + 0.05)[0] - motion.at(t - 0.05)[0]) / 0.1
        return xy[:, 0], v[:, 0], heading[:, 0]

    def track_enu(self, body: int, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One body in ENU at times t (k,), slope and waves included: position (k, 3), velocity (k, 3), heading (k,)."""
        xy, v, heading = self.track_of(body, t)
        climb = (self._waves(xy + 0.05 * v) - self._waves(xy - 0.05 * v)) / 0.1
        p = np.concatenate([xy, self._waves(xy)[:, None]], axis=1)
        v = np.concatenate([v, climb[:, None]], axis=1)
        if self.scenario.ground.slope_deg == 0.0:
            return p, v, heading
        R = self._R_enu_ground
        nose = np.stack([np.sin(heading), np.cos(heading)], axis=-1) @ R[:, :2].T
        return p @ R.T, v @ R.T, np.arctan2(nose[:, 0], nose[:, 1])

    def view(self, t: float) -> CameraView:
        """The true camera, in axes in which the ground is z = 0: ENU, tipped with the ground where it slopes."""
        view = view_from(self.scenario, self._flight.at(t))
        factor = next((zoom.factor for zoom in reversed(self.scenario.camera.zooms) if zoom.at_s <= t), 1.0)
        view = replace(view, fx=factor * view.fx, fy=factor * view.fy)
        if self.scenario.ground.slope_deg == 0.0:
            return view
        R = self._R_enu_ground
        return replace(view, R_enu_cam=R.T @ view.R_enu_cam, p_enu=R.T @ view.p_enu)

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
            z=np.concatenate([self._waves(state.xy), self._waves(canopies[:, :2])]),
        )

    def _waves(self, xy: FloatArray) -> FloatArray:
        """(n,) height of the ground at places xy (n, 2) above its mean plane: two crossing waves, 0 in the middle."""
        ground = self.scenario.ground
        k = 2.0 * np.pi / ground.wavelength_m
        return np.asarray(0.5 * ground.waves_m * (np.sin(k * xy[:, 0]) + np.sin(k * xy[:, 1])))

    def _fly(self, t: FloatArray) -> UavMotion:
        scenario = self.scenario
        if scenario.ground.is_open:
            filmed = np.zeros((len(t), 1, 2))
        else:
            filmed = self._actors.motion.xy[:, : scenario.ground.vehicles]
        rng, wobble_rng = random_stream(scenario, "flight"), random_stream(scenario, "wobble")
        return fly(t, filmed, scenario.flight, scenario.camera, rng, wobble_rng)

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


def _sloping(scenario: Scenario) -> FloatArray:
    """(3, 3) axes that lie in the ground into ENU: a turn about the horizontal that raises the uphill direction."""
    bearing, slope = np.radians([scenario.ground.uphill_deg, scenario.ground.slope_deg])
    uphill = np.array([np.sin(bearing), np.cos(bearing), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    axis = np.cross(uphill, up)
    K = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    # Rodrigues: R = 1 + sin σ K + (1 − cos σ) K²
    return np.asarray(np.eye(3) + np.sin(slope) * K + (1.0 - np.cos(slope)) * K @ K)


def random_stream(scenario: Scenario, purpose: str) -> np.random.Generator:
    """A generator of its own for each purpose, so that a change to one part leaves the others' draws alone."""
    return np.random.default_rng([scenario.seed, *purpose.encode()])
