"""Everything that moves or is parked on the ground: our vehicles, other ones, persons; sizes, appearance and motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.world.motion import STEP_S, Motion, joined
from sim.world.open_ground import Robots, drive_open, scatter
from sim.world.roads import Path, winding_path
from sim.world.scenario import Scenario, ScenarioGround
from sim.world.traffic import RoadAgents, drive_road, fleet_speed
from sim.world.view import OTHER_VEHICLE, PERSON, UGV, Road, Scene

FloatArray = NDArray[np.float64]
UGV_COLOR = (70, 120, 60)
"""BGR of our vehicles, an olive green; a choice."""
CAR_SIZE, PERSON_SIZE = (4.3, 1.8, 1.5), (0.5, 0.5, 1.7)
"""Length, width and height, metres: a medium car and a person seen from above."""
WALK_MPS = 1.3
"""A pedestrian's usual pace."""
BAYS, AISLE_M, REVERSED = 1.3, 6.0, 0.2
"""Bays a parked vehicle, width of the aisle between two rows, and share of vehicles that backed in; choices."""


def slots(formation: str, n: int, spacing_m: float) -> FloatArray:
    """(n, 2) metres ahead of and to the right of the formation's middle."""
    i = np.arange(n, dtype=np.float64)
    if formation == "line":
        places = np.stack([np.zeros(n), i], axis=-1)
    elif formation == "column":
        places = np.stack([-i, np.zeros(n)], axis=-1)
    elif formation == "wedge":
        rank = np.ceil(i / 2.0)
        places = np.stack([-rank, rank * np.where(i % 2 == 1, 1.0, -1.0)], axis=-1)
    elif formation == "triangle":
        rank = np.floor((np.sqrt(8.0 * i + 1.0) - 1.0) / 2.0)
        # rank r has r + 1 places, each half a side inwards of the next rank's
        along, across = -rank * np.sqrt(3.0) / 2.0, i - rank * (rank + 1.0) / 2.0 - rank / 2.0
        places = np.stack([along, across], axis=-1)
    else:
        columns = int(np.ceil(np.sqrt(n)))
        places = np.stack([-(i // columns), i % columns], axis=-1)
    centred: FloatArray = (places - 0.5 * (places.max(axis=0) + places.min(axis=0))) * spacing_m
    return centred


def drive_formation(
    path: Path, t: FloatArray, places: FloatArray, ground: ScenarioGround, rng: np.random.Generator
) -> Motion:
    """Hold places (n, 2) relative to a point that moves along the path, to within the station keeping."""
    cruise = fleet_speed(t, ground.speed_mps, rng)
    reference = np.concatenate([[0.0], np.cumsum(cruise[:-1]) * STEP_S])
    waves = _slow_waves(t, 2 * len(places), rng).reshape(len(t), len(places), 2)
    wander = ground.station_keeping_m * np.sqrt(2.0) * waves
    s = reference[:, None] + places[:, 0] + wander[..., 0]
    d = places[:, 1] + wander[..., 1]
    xy, theta, kappa = path.at(s, d)
    along = np.gradient(s, STEP_S, axis=0) * (1.0 - kappa * d)
    across = np.gradient(d, STEP_S, axis=0)
    return Motion(t=t, xy=xy, heading=theta + np.arctan2(across, along), speed=np.hypot(along, across))


def _slow_waves(t: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    periods, phases = rng.uniform(8.0, 25.0, n), rng.uniform(0.0, 2.0 * np.pi, n)
    return np.asarray(np.sin(2.0 * np.pi * t[:, None] / periods + phases))


@dataclass(frozen=True, slots=True, kw_only=True)
class Roles:
    """The n bodies in their fixed order: filmed, outside, look-alikes, moving, parked look-alikes, still, persons."""

    role: NDArray[np.str_]
    """(n,) one of the seven words below."""
    system_id: NDArray[np.int64]
    """(n,) 0 for those that are not ours."""
    kind: NDArray[np.int8]
    """(n,) appearance, as ``Bodies.kind``."""
    size: FloatArray
    """(n, 3) length, width, height in metres."""
    color: NDArray[np.uint8]
    """(n, 3) BGR."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Actors:
    """The bodies, how they move, and the roads."""

    roles: Roles
    motion: Motion
    scene: Scene


def choose_roles(scenario: Scenario, rng: np.random.Generator) -> Roles:
    """Sizes and appearance of all bodies of a scenario."""
    ground, targets = scenario.ground, scenario.targets
    counts = {
        "filmed": ground.vehicles,
        "outside": ground.outside,
        "lookalike": targets.lookalikes,
        "moving": targets.moving,
        "parked": targets.parked_lookalikes,
        "still": targets.still,
        "person": targets.persons,
    }
    role = np.repeat(list(counts), list(counts.values()))
    n = len(role)
    ours = np.isin(role, ("filmed", "outside"))
    like_ours = ours | np.isin(role, ("lookalike", "parked"))
    system_id = np.zeros(n, dtype=np.int64)
    system_id[ours] = scenario.ugv_ids
    kind = np.where(like_ours, UGV, np.where(role == "person", PERSON, OTHER_VEHICLE)).astype(np.int8)
    size = np.empty((n, 3))
    size[like_ours] = ground.length_m, ground.width_m, ground.height_m
    size[role == "moving"] = CAR_SIZE
    size[role == "still"] = rng.uniform((1.6, 1.1, 0.5), (2.6, 1.6, 1.2), (int((role == "still").sum()), 3))
    size[role == "person"] = PERSON_SIZE
    color = np.where(like_ours[:, None], UGV_COLOR, rng.integers(30, 220, (n, 3))).astype(np.uint8)
    return Roles(role=role, system_id=system_id, kind=kind, size=size, color=color)


def simulate_actors(scenario: Scenario, t: FloatArray, rng: np.random.Generator) -> Actors:
    """Move all bodies over the time grid t (T,), which begins no later than 0."""
    roles = choose_roles(scenario, rng)
    if scenario.ground.is_open:
        return Actors(roles=roles, motion=_on_open_ground(scenario, roles, t, rng), scene=Scene())
    path = _path(scenario, float(t[-1]), rng)
    if scenario.ground.kind == "formation":
        traffic, half_width = _in_formation(scenario, roles, path, t, rng), _formation_half_width(scenario)
        scene = Scene()
    else:
        traffic, half_width = _on_road(scenario, roles, path, t, rng), _road_width(scenario) / 2.0
        road = Road(centre=path.xy, width=_road_width(scenario), lanes=scenario.ground.lanes)
        scene = Scene(roads=(road,))
    motion = joined(traffic, _roadside(scenario, roles, path, t, half_width, rng))
    return Actors(roles=roles, motion=motion, scene=scene)


def reach_m(scenario: Scenario) -> float:
    """A distance from the image's middle that the image does not reach, metres on the ground."""
    camera, flight = scenario.camera, scenario.flight
    height = flight.height_m + max(0.0, flight.climb_mps) * scenario.duration_s
    half = 0.5 * np.hypot(camera.width / camera.fx, camera.height / camera.fy)
    return float(1.3 * half * height / np.sin(np.radians(-camera.pitch_deg)) ** 2)


def _path(scenario: Scenario, stop_s: float, rng: np.random.Generator) -> Path:
    ground = scenario.ground
    ahead = ground.speed_mps * stop_s * 2.0
    margin = 200.0 + 3.0 * reach_m(scenario) + scenario.fleet_size * ground.spacing_m
    bend = np.radians(0.0 if ground.kind == "straight" else ground.bend_deg)
    if ground.kind == "formation":
        # |κ| ≤ 1.2 β 2π / L; the inner flank of a turning formation must still move forwards
        bend = min(0.4 * bend, 0.4 / _formation_half_width(scenario) * ground.bend_length_m / (2.4 * np.pi))
    return winding_path(rng, -margin, ahead + margin, np.radians(ground.road_deg), bend, ground.bend_length_m)


def _road_width(scenario: Scenario) -> float:
    return scenario.ground.lanes * scenario.ground.lane_width_m + 1.0


def _stations(scenario: Scenario, inside: int) -> FloatArray:
    """(outside,) metres along the road of the vehicles beyond the image, alternately behind and ahead."""
    i = np.arange(scenario.ground.outside)
    rows = np.ceil(inside / scenario.ground.lanes)
    away = 0.5 * rows * scenario.ground.spacing_m + 1.8 * reach_m(scenario) + (i // 2) * scenario.ground.spacing_m
    return np.asarray(np.where(i % 2 == 0, -away, away))


def _on_road(scenario: Scenario, roles: Roles, path: Path, t: FloatArray, rng: np.random.Generator) -> Motion:
    ground = scenario.ground
    count = {word: int((roles.role == word).sum()) for word in ("filmed", "outside", "lookalike", "moving")}
    inside = count["filmed"] + count["lookalike"]
    rows = -(-inside // ground.lanes)
    # neighbours in different lanes are staggered, so that no order along the road is given away
    order = rng.permutation(inside)
    lane = np.concatenate([order % ground.lanes, rng.integers(0, ground.lanes, count["outside"] + count["moving"])])
    s = (order // ground.lanes - 0.5 * (rows - 1) + 0.4 * (order % ground.lanes) / ground.lanes) * ground.spacing_m
    away = _stations(scenario, inside)
    behind = -0.5 * rows * ground.spacing_m - 12.0 - 14.0 * np.arange(count["moving"])
    filmed, alike = np.split(s, [count["filmed"]])
    lane = np.concatenate(
        [
            lane[: count["filmed"]],
            lane[inside : inside + count["outside"]],
            lane[count["filmed"] : inside],
            lane[inside + count["outside"] :],
        ]
    )
    n = len(lane)
    size = roles.size[:n]
    moving = roles.role[:n] == "moving"
    agents = RoadAgents(
        s=np.concatenate([filmed, away, alike, behind]) + ground.speed_mps * float(t[0]),
        lane=lane.astype(np.int64),
        length=size[:, 0],
        width=size[:, 1],
        pace=np.where(moving, 1.3, 1.0),
        cooperative=~moving,
        fixed_lane=np.zeros(n, dtype=bool),
    )
    return drive_road(path, t, agents, ground, rng)


def _formation_half_width(scenario: Scenario) -> float:
    inside = scenario.ground.vehicles + scenario.targets.lookalikes
    places = slots(scenario.ground.formation, inside, scenario.ground.spacing_m)
    return float(places[:, 1].max()) + 2.0


def _in_formation(scenario: Scenario, roles: Roles, path: Path, t: FloatArray, rng: np.random.Generator) -> Motion:
    ground = scenario.ground
    inside = ground.vehicles + scenario.targets.lookalikes
    places = slots(ground.formation, inside, ground.spacing_m)
    places = places[rng.permutation(inside)]
    half_length, beside = float(places[:, 0].max()), _formation_half_width(scenario) + 4.0
    away = _stations(scenario, inside)
    outside = np.stack([away + np.sign(away) * half_length, np.zeros(len(away))], axis=-1)
    i = np.arange(scenario.targets.moving)
    moving = np.stack([(i // 2) * 9.0 - 6.0, np.where(i % 2 == 0, beside, -beside)], axis=-1)
    all_places = np.concatenate([places[: ground.vehicles], outside, places[ground.vehicles :], moving])
    return drive_formation(path, t, all_places, ground, rng)


def _roadside(
    scenario: Scenario, roles: Roles, path: Path, t: FloatArray, half_width: float, rng: np.random.Generator
) -> Motion:
    """Objects and persons beside the road, spread over the ground that the fleet passes."""
    role = roles.role[np.isin(roles.role, ("parked", "still", "person"))]
    n = len(role)
    passed = scenario.ground.speed_mps * scenario.duration_s
    s = passed * (rng.permutation(n) + rng.uniform(0.2, 0.8, n)) / max(n, 1)
    side = np.where(rng.random(n) < 0.5, -1.0, 1.0)
    person = role == "person"
    # each person walks a line of its own, inside of the standing objects, so that none walks through another
    line = half_width + 1.0 + 0.8 * np.cumsum(person)
    d = side * np.where(person, line, half_width + 3.0 + 0.8 * person.sum() + rng.uniform(0.0, 1.0, n))
    walk = np.where(person, np.where(rng.random(n) < 0.5, -WALK_MPS, WALK_MPS), 0.0)
    xy, theta, _ = path.at(s + walk * t[:, None], np.broadcast_to(d, (len(t), n)))
    facing = np.where(walk < 0.0, np.pi, np.where(person, 0.0, rng.normal(0.0, 0.4, n)))
    return Motion(t=t, xy=xy, heading=theta + facing, speed=np.broadcast_to(np.abs(walk), theta.shape))


def _on_open_ground(scenario: Scenario, roles: Roles, t: FloatArray, rng: np.random.Generator) -> Motion:
    ground = scenario.ground
    n = len(roles.role)
    away = roles.role == "outside"
    bearing = rng.uniform(0.0, 2.0 * np.pi) + np.arange(n) * 2.4
    distance = 1.8 * reach_m(scenario) + 0.5 * np.hypot(*ground.area_m)
    centre = np.where(away[:, None], distance * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1), 0.0)
    area = np.broadcast_to(np.array(ground.area_m), (n, 2)).copy()
    still = np.isin(roles.role, ("parked", "still"))
    if ground.kind in ("parked", "bays"):
        still |= np.isin(roles.role, ("filmed", "outside", "lookalike"))
    person = roles.role == "person"
    speed = ground.speed_mps * rng.uniform(0.75, 1.1, n)
    radius = 0.5 * np.hypot(roles.size[:, 0], roles.size[:, 1])
    apart = max(0.5, ground.spacing_m - 2.0 * float(radius.max())) if ground.kind == "parked" else 0.8
    xy = scatter(centre, area, radius, apart, rng)
    eight = ~person & ~still & ~away & (rng.random(n) < 0.25)
    robots = Robots(
        xy=xy,
        radius=radius,
        speed=np.where(still, 0.0, np.where(person, WALK_MPS, speed)),
        pivots=person | (rng.random(n) < 0.4),
        eight=eight,
        centre=np.where(eight[:, None], 0.5 * xy, centre),
        area=np.where(eight[:, None], np.minimum(area * 0.5, 18.0), area),
    )
    motion = drive_open(t, robots, rng)
    return _in_bays(motion, scenario, roles, rng) if ground.kind == "bays" else motion


def _in_bays(motion: Motion, scenario: Scenario, roles: Roles, rng: np.random.Generator) -> Motion:
    """The motion with all vehicles of our make that are filmed in bays: two rows with an aisle between them."""
    ground, parked = scenario.ground, np.flatnonzero(np.isin(roles.role, ("filmed", "lookalike", "parked")))
    a_row = math.ceil(len(parked) * BAYS / 2.0)
    bay = rng.permutation(2 * a_row)[: len(parked)]
    row = bay // a_row
    xy, heading = motion.xy.copy(), motion.heading.copy()
    xy[:, parked, 0] = ground.spacing_m * (bay % a_row - 0.5 * (a_row - 1))
    xy[:, parked, 1] = (row - 0.5) * (ground.length_m + AISLE_M)
    heading[:, parked] = np.pi * ((row + (rng.random(len(parked)) < REVERSED)) % 2)
    return replace(motion, xy=xy, heading=heading)
