"""Robots on open ground: random waypoints, figure eights, pivots on the spot and reverse legs, never into one another.

Each robot is a disc round its box. Robots slow down so that both of a closing pair can stop within half of the space
that is left; one that is held up backs off and takes another goal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import ScenarioError
from sim.world.motion import STEP_S, Motion, wrapped

FloatArray = NDArray[np.float64]

ACCEL = 1.5  # m/s²
TURN_RADIUS_M, MAX_TURN_RATE = 3.0, 1.2  # of steered robots; of those that pivot, rad/s
ARRIVED_M, LOOKAHEAD_M = 1.5, 2.5
"""A goal is reached within the first; on a figure of eight the goal is kept the second ahead. Both are a choice."""
PATIENCE_S, LEG_TIMEOUT_S = 1.0, 15.0
"""A robot that is held up this long backs off; a leg ends after this long at the latest. Both are a choice."""
REVERSE_SHARE = 0.12
"""Probability that a leg after one forwards is driven in reverse; a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Robots:
    """n robots at the start."""

    xy: FloatArray
    """(n, 2) ENU metres."""
    radius: FloatArray
    """(n,) of the disc that holds the box at any heading."""
    speed: FloatArray
    """(n,) cruising speed, m/s."""
    pivots: NDArray[np.bool_]
    """(n,) skid steering: turns on the spot; the others need room."""
    eight: NDArray[np.bool_]
    """(n,) drives figure eights round its start."""
    centre: FloatArray
    """(n, 2) middle of the robot's own area."""
    area: FloatArray
    """(n, 2) extent of that area, east and north."""


def drive_open(t: FloatArray, robots: Robots, rng: np.random.Generator) -> Motion:
    """Drive all robots over the time grid t (T,)."""
    field = _Field(robots, rng)
    shape = (len(t), len(robots.xy))
    xy, heading, speed = np.empty((*shape, 2)), np.empty(shape), np.empty(shape)
    for k, now in enumerate(t):
        xy[k], heading[k], speed[k] = field.xy, field.heading, field.v * field.gear
        field.step(float(now))
    return Motion(t=t, xy=xy, heading=heading, speed=speed)


def scatter(
    centre: FloatArray, area: FloatArray, radius: FloatArray, apart_m: float, rng: np.random.Generator
) -> FloatArray:
    """(n, 2) random places, each in its own area, with ``apart_m`` left free between any two discs.

    Raises:
        ScenarioError: if they do not fit.
    """
    placed = np.empty((len(radius), 2))
    for i in range(len(radius)):
        for _ in range(3000):
            placed[i] = centre[i] + rng.uniform(-0.5, 0.5, 2) * area[i]
            room = np.linalg.norm(placed[:i] - placed[i], axis=1) - radius[:i] - radius[i]
            if np.all(room > apart_m):
                break
        else:
            raise ScenarioError(
                f"scenario: {len(radius)} bodies do not fit on the ground {apart_m:g} m apart; "
                "enlarge ground.area_m, or lessen ground.spacing_m or their number"
            )
    return placed


class _Field:
    """State of all robots at one instant."""

    def __init__(self, robots: Robots, rng: np.random.Generator) -> None:
        n = len(robots.xy)
        self._robots, self._rng = robots, rng
        self.xy = robots.xy.copy()
        self.heading = rng.uniform(-np.pi, np.pi, n)
        self.v = np.zeros(n)
        self.gear = np.ones(n)
        self._goal = np.stack([self._waypoint(i) for i in range(n)])
        self._phase = rng.uniform(0.0, 2.0 * np.pi, n)
        self._leg_end = np.full(n, -np.inf)
        self._held_s = np.zeros(n)
        self._touch = robots.radius[:, None] + robots.radius
        np.fill_diagonal(self._touch, 0.0)

    def step(self, now: float) -> None:
        self._choose_goals(now)
        to_goal = self._goal - self.xy
        # in reverse the rear is what is steered to the goal
        nose = self.heading + np.where(self.gear < 0.0, np.pi, 0.0)
        error = wrapped(np.arctan2(to_goal[:, 0], to_goal[:, 1]) - nose)
        wanted = self._robots.speed * np.where(
            self._robots.pivots, np.clip(1.5 * np.cos(error) - 0.3, 0.0, 1.0), np.clip(np.cos(error), 0.35, 1.0)
        )
        wanted = np.where(self.gear < 0.0, 0.5 * wanted, wanted)
        direction = np.stack([np.sin(nose), np.cos(nose)], axis=-1)
        allowed = self._allowed(direction)
        held = (allowed < 0.15) & (wanted > 0.3)
        self._held_s = np.where(held, self._held_s + STEP_S, 0.0)
        self.v = np.minimum(np.clip(wanted, self.v - 2.0 * ACCEL * STEP_S, self.v + ACCEL * STEP_S), allowed)
        rate = np.where(self._robots.pivots, MAX_TURN_RATE, np.minimum(self.v / TURN_RADIUS_M, MAX_TURN_RATE))
        rate = np.where(self._robots.speed > 0.0, rate, 0.0)
        self.heading = self.heading + np.clip(2.0 * error, -rate, rate) * STEP_S
        self._advance(direction * self.v[:, None] * STEP_S)

    def _allowed(self, direction: FloatArray) -> FloatArray:
        """(n,) highest speed at which each robot can still stop in its half of every gap it closes."""
        offset = self.xy - self.xy[:, None]
        distance = np.linalg.norm(offset, axis=-1) + np.eye(len(self.xy)) * 1e9
        closing = np.einsum("ijk,ik->ij", offset, direction) / distance
        room = np.maximum(distance - self._touch - 0.3, 0.0)
        # v cos γ ≤ √(2 a · gap / 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = np.where(closing > 0.02, np.sqrt(ACCEL * room) / np.maximum(closing, 0.02), np.inf)
        return np.asarray(limit.min(axis=1))

    def _advance(self, move: FloatArray) -> None:
        """Move; a robot that would touch another waits for this step."""
        while True:
            ahead = self.xy + move
            distance = np.linalg.norm(ahead - ahead[:, None], axis=-1)
            before = np.linalg.norm(self.xy - self.xy[:, None], axis=-1)
            touching = np.any((distance < self._touch) & (distance < before), axis=1)
            if not touching.any():
                break
            move = np.where(touching[:, None], 0.0, move)
            self.v = np.where(touching, 0.0, self.v)
        self.xy = self.xy + move

    def _choose_goals(self, now: float) -> None:
        distance = np.linalg.norm(self._goal - self.xy, axis=1)
        back_off = self._held_s > PATIENCE_S
        leg = ~self._robots.eight | (now < self._leg_end)
        for i in np.flatnonzero(back_off | (leg & ((distance < ARRIVED_M) | (now > self._leg_end)))):
            self._new_leg(int(i), now, bool(back_off[i]))
        for i in np.flatnonzero(self._robots.eight & (now >= self._leg_end)):
            self._follow_eight(int(i))

    def _new_leg(self, i: int, now: float, back_off: bool) -> None:
        if back_off:
            self.gear[i] = -self.gear[i]
            nose = self.heading[i] + (np.pi if self.gear[i] < 0 else 0.0) + self._rng.uniform(-0.6, 0.6)
            self._goal[i] = self.xy[i] + 6.0 * np.array([np.sin(nose), np.cos(nose)])
            self._leg_end[i] = now + self._rng.uniform(1.5, 3.0)
        else:
            self.gear[i] = -1.0 if self._rng.random() < REVERSE_SHARE and self.gear[i] > 0 else 1.0
            self._goal[i] = self._waypoint(i)
            self._leg_end[i] = now + (LEG_TIMEOUT_S if self.gear[i] > 0 else self._rng.uniform(2.0, 4.0))
        self._held_s[i] = 0.0

    def _follow_eight(self, i: int) -> None:
        self.gear[i] = 1.0
        for _ in range(40):
            phase = self._phase[i]
            # a lemniscate of Gerono: (sin φ, sin φ cos φ)
            shape = np.array([np.sin(phase), np.sin(phase) * np.cos(phase)])
            self._goal[i] = self._robots.centre[i] + shape * self._robots.area[i] * (0.45, 0.8)
            if np.hypot(*(self._goal[i] - self.xy[i])) > LOOKAHEAD_M:
                break
            self._phase[i] += 0.03

    def _waypoint(self, i: int) -> FloatArray:
        spot: FloatArray = self._robots.centre[i] + self._rng.uniform(-0.5, 0.5, 2) * self._robots.area[i]
        return spot
