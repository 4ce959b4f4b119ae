"""Scenery makes images richer and changes nothing that is true."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from sim.render.film import CLEAR_M, Film, random_scenery
from sim.render.randomise import FIRST_KIND
from sim.world.presets import curved_road
from sim.world.view import OCCLUDER
from sim.world.world import World
from tests.support.bundled import ROOT

BUNDLED = ROOT / "sitl_logs"


@pytest.fixture(scope="module")
def world():
    return World(curved_road())


def test_nothing_stands_on_a_lane_or_in_anybodys_way(world):
    bodies = random_scenery(world).bodies
    places = np.column_stack([bodies.x, bodies.y])
    reach = 0.5 * np.hypot(bodies.length, bodies.width)
    assert len(places) > 30
    for road in world.scene.roads:
        gap = np.hypot(*(places[:, None] - road.centre).transpose(2, 0, 1)).min(axis=1)
        assert (gap - reach - 0.5 * road.width > CLEAR_M).all()
    for t in np.arange(0.0, world.scenario.duration_s, 1.7):
        gap = np.hypot(*(places[:, None] - world.at(float(t)).xy).transpose(2, 0, 1)).min(axis=1)
        assert (gap > reach).all()


def test_nothing_of_it_is_a_vehicle(world):
    dressing = random_scenery(world)
    assert set(dressing.bodies.kind.tolist()) >= {OCCLUDER}
    assert all(kind == OCCLUDER or kind >= FIRST_KIND for kind in dressing.bodies.kind.tolist())


@pytest.mark.slow
def test_scenery_is_in_the_image_only(world):
    bare = World(replace(curved_road(), scenery="bare"))
    assert np.array_equal(bare.bodies(3.0).x, world.bodies(3.0).x)
    small = replace(
        curved_road(),
        camera=replace(curved_road().camera, width=480, height=270, fx=300.0, fy=300.0, cx=240.0, cy=135.0),
    )
    dressed, again = (Film(World(small)).image(3.0, 30) for _ in range(2))
    assert np.array_equal(dressed, again)
    plain = Film(World(replace(small, scenery="bare"))).image(3.0, 30)
    assert (np.abs(dressed.astype(int) - plain).max(axis=2) > 20).mean() > 0.05


def test_bundled_recordings_are_as_recorded():
    lines = (BUNDLED / "checksums").read_text().splitlines()
    assert len(lines) == sum(
        path.is_file() for folder in BUNDLED.iterdir() if folder.is_dir() for path in folder.iterdir()
    )
    for line in lines:
        digest, name = line.split()
        assert hashlib.sha256((BUNDLED / name).read_bytes()).hexdigest() == digest, name
