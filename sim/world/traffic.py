"""Vehicles on a road: car following, lane changes and stops, so that no two run through one another.

Along the lane each vehicle follows the intelligent driver model (Treiber, Hennecke, Helbing 2000, Phys. Rev. E 62,
1805); across it the heading relative to the road changes only with distance driven, as a steered vehicle's does.
Vehicles of the fleet are drawn softly to a station that moves with the fleet, which keeps them together and makes them
overtake.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.world.motion import STEP_S, Motion
from sim.world.roads import Path
from sim.world.scenario import ScenarioGround

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ACCEL, BRAKE, HARD_BRAKE = 1.5, 2.0, 6.0  # m/s²
STANDSTILL_M, HEADWAY_S = 2.0, 0.7
"""Gap to the vehicle ahead: at rest, and the time that is added with speed."""
SIDE_M = 0.5  # lateral clearance below which two vehicles are in each other's way
MAX_SLOPE, SLOPE_PER_M, SLOPE_GAIN = 0.2, 0.06, 0.1  # sideways per metre driven


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadAgents:
    """n vehicles at the start."""

    s: FloatArray
    """(n,) place along the road, metres."""
    lane: IntArray
    """(n,) 0 is the leftmost."""
    length: FloatArray
    width: FloatArray
    pace: FloatArray
    """(n,) cruising speed over the fleet's; 1 holds the station."""
    cooperative: NDArray[np.bool_]
    """(n,) drawn to a station in the fleet."""
    fixed_lane: NDArray[np.bool_]
    """(n,) never changes lane."""


def lane_offset(lane: IntArray | int, ground: ScenarioGround) -> FloatArray:
    """Metres to the right of the centre line of a lane's middle."""
    return (np.asarray(lane, dtype=np.float64) - 0.5 * (ground.lanes - 1)) * ground.lane_width_m


def fleet_speed(t: FloatArray, speed_mps: float, rng: np.random.Generator) -> FloatArray:
    """(T,) a cruising speed that wanders by about a quarter."""
    periods, phases = rng.uniform(12.0, 45.0, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = np.sin(2.0 * np.pi * t[:, None] / periods + phases).mean(axis=1)
    return np.asarray(speed_mps * (1.0 + 0.35 * waves))


def drive_road(
    path: Path, t: FloatArray, agents: RoadAgents, ground: ScenarioGround, rng: np.random.Generator
) -> Motion:
    """Drive all vehicles over the time grid t (T,)."""
    traffic = _RoadState(path, agents, ground, rng)
    cruise = fleet_speed(t, ground.speed_mps, rng)
    reference = np.concatenate([[0.0], np.cumsum(cruise[:-1]) * STEP_S])
    shape = (len(t), len(agents.s))
    s, d, v, slope = np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)
    for k, now in enumerate(t):
        s[k], d[k], v[k], slope[k] = traffic.s, traffic.d, traffic.v, traffic.slope
        traffic.step(float(now), float(cruise[k]), float(reference[k]))
    xy, theta, _ = path.at(s, d)
    return Motion(t=t, xy=xy, heading=theta + np.arctan(slope), speed=v * np.sqrt(1.0 + slope * slope))


class _RoadState:
    """State of all vehicles on the road at one instant."""

    def __init__(self, path: Path, agents: RoadAgents, ground: ScenarioGround, rng: np.random.Generator) -> None:
        n = len(agents.s)
        self._path, self._agents, self._ground, self._rng = path, agents, ground, rng
        self.s = agents.s.copy()
        self.goal = lane_offset(agents.lane, ground)
        self.d = self.goal.copy()
        self.v = np.full(n, ground.speed_mps) * agents.pace
        self.slope = np.zeros(n)
        self._stop_until = np.full(n, -np.inf)
        self._length = 0.5 * (agents.length[:, None] + agents.length)
        self._clear = 0.5 * (agents.width[:, None] + agents.width) + SIDE_M
        self._wander = rng.uniform(0.3, 0.8, n) * ground.spacing_m
        self._period = rng.uniform(15.0, 40.0, n)
        self._phase = rng.uniform(0.0, 2.0 * np.pi, n)

    def step(self, now: float, cruise: float, reference: float) -> None:
        wanted = self._wanted_speed(now, cruise, reference)
        gap, closing = self._leaders()
        self._change_lanes(wanted, gap)
        accel = _follow(self.v, wanted, gap, closing)
        self.v = np.maximum(self.v + accel * STEP_S, 0.0)
        _, _, kappa = self._path.at(self.s)
        # ds/dt = v / (1 − κ d), dd/dt = v m, dm/ds bounded
        aim = np.clip(SLOPE_GAIN * (self.goal - self.d), -MAX_SLOPE, MAX_SLOPE)
        turn = SLOPE_PER_M * self.v * STEP_S
        self.slope = self.slope + np.clip(aim - self.slope, -turn, turn)
        self.d = self.d + self.v * self.slope * STEP_S
        self.s = self.s + self.v / (1.0 - kappa * self.d) * STEP_S

    def _wanted_speed(self, now: float, cruise: float, reference: float) -> FloatArray:
        wander = self._wander * np.sin(2.0 * np.pi * now / self._period + self._phase)
        behind = self._agents.s + wander + reference - self.s
        pull = np.where(self._agents.cooperative, 0.35 * behind, 0.0)
        stops = self._rng.random(len(self.s)) < self._ground.stops_per_min / 60.0 * STEP_S
        self._stop_until = np.where(stops, now + self._rng.uniform(1.5, 3.5, len(self.s)), self._stop_until)
        wanted = np.clip(cruise * self._agents.pace + pull, 0.3 * cruise, 1.8 * cruise * self._agents.pace)
        return np.asarray(np.where(now < self._stop_until, 0.0, wanted))

    def _leaders(self) -> tuple[FloatArray, FloatArray]:
        """Free metres before each vehicle and the speed at which they shrink; inf and 0 on a free road."""
        lateral = np.abs(self.d[:, None] - self.d) < self._clear
        lateral |= np.abs(self.goal[:, None] - self.d) < self._clear
        lateral |= np.abs(self.d[:, None] - self.goal) < self._clear
        ahead = self.s - self.s[:, None]
        gap = np.where(lateral & (ahead > 0.0), ahead - self._length, np.inf)
        leader = np.argmin(gap, axis=1)
        free = gap[np.arange(len(leader)), leader]
        return free, np.where(np.isfinite(free), self.v - self.v[leader], 0.0)

    def _change_lanes(self, wanted: FloatArray, gap: FloatArray) -> None:
        rate = np.full(len(self.s), self._ground.lane_changes_per_min / 60.0)
        rate[(gap < 8.0) & (self.v < wanted - 0.8)] += 0.4 * float(self._ground.lane_changes_per_min > 0.0)
        draws = self._rng.random((2, len(self.s)))
        settled = np.abs(self.goal - self.d) < 0.3
        willing = (draws[0] < rate * STEP_S) & settled & (self.v > 0.5) & ~self._agents.fixed_lane
        for i in np.flatnonzero(willing):
            side = self._ground.lane_width_m * (1.0 if draws[1, i] < 0.5 else -1.0)
            for goal in (self.goal[i] + side, self.goal[i] - side):
                if self._is_free(int(i), float(goal)):
                    self.goal[i] = goal
                    break

    def _is_free(self, i: int, goal: float) -> bool:
        edge = float(lane_offset(self._ground.lanes - 1, self._ground))
        if abs(goal) > edge + 1e-6:
            return False
        near = np.abs(self.s - self.s[i]) < self._length[i] + 2.5 + 0.6 * self.v
        beside = (np.abs(self.d - goal) < self._clear[i]) | (np.abs(self.goal - goal) < self._clear[i])
        near[i] = False
        return not bool(np.any(near & beside))


def _follow(v: FloatArray, wanted: FloatArray, gap: FloatArray, closing: FloatArray) -> FloatArray:
    """Acceleration of the intelligent driver model, bounded."""
    # a [1 − (v/v₀)⁴ − (s*/s)²],  s* = s₀ + v T + v Δv / (2 √(a b))
    desired = STANDSTILL_M + np.maximum(0.0, v * HEADWAY_S + v * closing / (2.0 * np.sqrt(ACCEL * BRAKE)))
    free = np.where(wanted > 0.05, 1.0 - (v / np.maximum(wanted, 0.05)) ** 4, -BRAKE / ACCEL)
    accel = ACCEL * (np.maximum(free, -BRAKE / ACCEL) - (desired / np.maximum(gap, 0.1)) ** 2)
    return np.asarray(np.clip(accel, -HARD_BRAKE, ACCEL))
