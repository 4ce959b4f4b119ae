from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.render.exposure import Exposure
from sim.render.open_scene import random_scene
from sim.render.randomise import FIRST_KIND, HEAVY, SIZES, URBAN, VEHICLES, random_catalogue, random_style
from sim.render.render import DEFAULT_MODELS, Renderer
from sim.render.training_ground import random_training_ground
from sim.world.view import OCCLUDER, UGV, Bodies, CameraView, Scene, ray_ground
from training.rendered.crops import MAX_BOXES, SIDE, _random_view, crop, labels, seen_sides, write_shard
from training.rendered.footage import as_footage
from training.rendered.placing import random_bodies

pytestmark = pytest.mark.slow


def camera(height=40.0, size=(640, 360), focal=400.0):
    return CameraView(
        width=size[0], height=size[1], fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, distortion=np.zeros(5),
        R_enu_cam=np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]), p_enu=np.array([0.0, 0.0, height]),
    )  # fmt: skip


NOTHING = np.zeros(0)
EMPTY = Bodies(
    kind=np.zeros(0, np.int8),
    x=NOTHING,
    y=NOTHING,
    heading=NOTHING,
    length=NOTHING,
    width=NOTHING,
    height=NOTHING,
    color=np.zeros((0, 3), np.uint8),
)


@pytest.fixture(scope="module")
def ground():
    """The first of the seeds that has streets or car parks."""
    return next(
        y for y in (random_training_ground(np.random.default_rng(seed)) for seed in range(20)) if len(y.slots.x) > 100
    )


@pytest.fixture(scope="module")
def catalogue():
    return random_catalogue(np.random.default_rng(1))


def standing(heading, height):
    return Bodies(
        kind=np.array([UGV], np.int8),
        x=np.zeros(1),
        y=np.zeros(1),
        heading=np.array([heading]),
        length=np.array([4.0]),
        width=np.array([2.0]),
        height=np.array([height]),
        color=np.zeros((1, 3), np.uint8),
    )


@pytest.mark.parametrize(("heading", "taller"), [(0.0, 0), (0.5 * np.pi, 1)])
def test_from_the_side_the_height_of_a_body_adds_to_the_side_that_it_rises_along(heading, taller):
    """45° down towards north: a vehicle that drives north rises along its length, one that drives east across it."""
    s = np.sqrt(0.5)
    down_north = np.column_stack([[1.0, 0.0, 0.0], [0.0, -s, -s], [0.0, s, -s]])
    view = replace(camera(), R_enu_cam=down_north, p_enu=np.array([0.0, -40.0, 40.0]))
    sides = {}
    for height in (0.01, 1.5):
        body = standing(heading, height)
        sides[height] = seen_sides(view, body, DEFAULT_MODELS, labels(view, body))[0]
    px_per_m = 400.0 / np.hypot(40.0, 40.0)
    added = (sides[1.5] - sides[0.01]) / (1.5 * s * px_per_m)
    assert 0.3 < added[taller] < 1.1
    assert abs(added[1 - taller]) < 0.2


def test_labels_straight_down():
    one = Bodies(
        kind=np.array([UGV], np.int8),
        x=np.array([5.0]),
        y=np.array([-3.0]),
        heading=np.array([1.0]),
        length=np.array([2.2]),
        width=np.array([1.4]),
        height=np.array([0.0]),
        color=np.zeros((1, 3), np.uint8),
    )
    (label,) = labels(camera(), one)  # 10 px/m at z = 0, image up is north
    np.testing.assert_allclose(label, [320 + 50, 180 + 30, 22, 14, 1.0], atol=1e-9)


def test_one_seed_gives_one_image(ground, catalogue):
    first, again, other = (crop(ground, catalogue, np.random.default_rng([5, k])) for k in (0, 0, 1))
    np.testing.assert_array_equal(first.image, again.image)
    np.testing.assert_array_equal(first.boxes, again.boxes)
    assert (first.image != other.image).any()


def test_crops_hold_their_vehicles_and_nothing_else(ground, catalogue):
    made = [crop(ground, catalogue, np.random.default_rng([5, k])) for k in range(6)]
    boxes = np.concatenate([m.boxes for m in made])
    assert all(m.image.shape == (SIDE, SIDE, 3) for m in made)
    assert len(boxes) > 20
    inside = ((boxes[:, :2] > 0) & (boxes[:, :2] < SIDE)).all(axis=1)
    # of those beyond the edge an end may be in the image: nothing is learnt from it
    assert 0.0 < (~inside).mean() < 0.4
    assert (boxes[~inside, 5] == 0.0).all()
    assert ((boxes[:, 5] >= 0.0) & (boxes[:, 5] <= 1.0)).all()
    assert (boxes[:, 5] > 0.5).mean() > 0.4
    assert OCCLUDER not in VEHICLES


def test_every_labelled_vehicle_is_drawn(ground, catalogue):
    """Seen from anywhere: without its bodies an image differs in the middle of every vehicle in sight."""
    rng = np.random.default_rng(8)
    for _ in range(5):
        view = _random_view(ground, rng, SIDE)
        things = random_bodies(view, ground, catalogue, rng)
        style = replace(random_style(rng, catalogue), exposure=Exposure(noise=0.0, vignette=0.0), shadow=0.0)
        renderer = Renderer(Scene(), style, ground=ground)
        drawn = (renderer.draw(view, things) != renderer.draw(view, EMPTY)).any(axis=-1)
        boxes = labels(view, things)
        vehicles = (things.kind != OCCLUDER) & np.isfinite(boxes).all(axis=1) & (boxes[:, 2] > 10.0)
        for u, v in boxes[vehicles, :2].astype(int):
            if 4 <= u < SIDE - 4 and 4 <= v < SIDE - 4:
                assert drawn[v - 2 : v + 3, u - 2 : u + 3].mean() > 0.5


def test_a_thermal_image_is_grey_and_has_the_boxes_of_daylight(ground, catalogue, monkeypatch):
    made = []
    for share in (0.0, 1.0):
        monkeypatch.setattr("training.rendered.crops.THERMAL_SHARE", share)
        made.append(crop(ground, catalogue, np.random.default_rng([5, 1])))
    day, warm = made
    np.testing.assert_array_equal(day.boxes, warm.boxes)
    assert np.ptp(day.image.astype(int), axis=-1).max() > 20
    assert np.ptp(warm.image.astype(int), axis=-1).max() == 0
    assert warm.image.std() > 5.0


def test_a_shard_is_what_training_reads(tmp_path):
    with np.load(write_shard(tmp_path, 3, 2)) as shard:
        assert shard["images"].shape == (2, SIDE, SIDE, 3)
        assert shard["boxes"].shape == (2, MAX_BOXES, 6)
        assert shard["about"].shape == (2, 5)
        assert (shard["n"] <= MAX_BOXES).all()


def test_no_body_stands_in_another(ground, catalogue):
    """Vehicles of an image, as rectangles on the ground: the middle line of none runs through another."""
    view = camera(height=120.0)
    for seed in range(4):
        things = random_bodies(view, ground, catalogue, np.random.default_rng(seed))
        solid = np.flatnonzero(things.kind != OCCLUDER)
        forward = np.stack([np.sin(things.heading), np.cos(things.heading)], axis=-1)
        right = np.stack([forward[:, 1], -forward[:, 0]], axis=-1)
        at = np.stack([things.x, things.y], axis=-1)
        for i in solid:
            t = np.linspace(-0.45, 0.45, 9)[:, None] * things.length[i]
            line = at[i] + t * forward[i]
            for j in solid[solid != i]:
                offset = line - at[j]
                ahead, aside = offset @ forward[j], offset @ right[j]
                inside = (np.abs(ahead) < 0.45 * things.length[j]) & (np.abs(aside) < 0.45 * things.width[j])
                assert not inside.any()


def test_depots_have_rows_of_long_bays_that_face_the_same_way():
    slots = (random_training_ground(np.random.default_rng(seed)).slots for seed in range(40))
    # bays of one depot are of one length, places in lanes are not
    alike = ((s, (s.length > 9.0) & ((s.length[:, None] == s.length).sum(axis=1) > 20)) for s in slots)
    long, chosen = next((s, a) for s, a in alike if a.any())
    bays = np.flatnonzero(chosen)
    at = np.stack([long.x, long.y], axis=-1)
    gap = np.hypot(*(at[bays][:, None] - at[bays][None]).transpose(2, 0, 1)) + 1e3 * np.eye(len(bays))
    beside = gap.argmin(axis=1)
    side_by_side = gap.min(axis=1) < 4.5
    assert side_by_side.mean() > 0.3
    turned = long.heading[bays] - long.heading[bays][beside]
    assert np.median(np.cos(turned[side_by_side])) > 0.99


def test_long_containers_count_neither_way():
    """From above they look like trailers."""
    rng = np.random.default_rng(3)
    box = next(kind for _ in range(99) for kind in random_catalogue(rng) if kind.name == "container")
    grounds = (random_training_ground(np.random.default_rng(seed)) for seed in range(20))
    bare = next(g for g in grounds if not len(g.slots.x))
    weights = []
    for length in (8.0, 3.0):
        made = [crop(bare, (replace(box, size=(length, 2.4, 2.6)),), np.random.default_rng([4, k])) for k in range(6)]
        weights.append(np.concatenate([m.boxes[:, 5] for m in made]))
    assert len(weights[0]) > 3
    assert (weights[0] == 0.0).all()
    assert len(weights[1]) == 0


def test_heavy_and_urban_kinds_leave_the_others_as_they_are():
    """Scenery of a flight is drawn from the same tables, and stays what it was."""
    plain = random_catalogue(np.random.default_rng(4))
    full = random_catalogue(np.random.default_rng(4), heavy=4, urban=5)
    assert [k.name for k in full[: len(plain)]] == [k.name for k in plain]
    assert all(k.group == "road" and k.size[0] > 5.0 for k in full[len(plain) : -5])
    assert all(k.group == "clutter" for k in full[-5:])


@pytest.mark.parametrize("name", [entry[0] for entry in (*HEAVY, *URBAN) if entry[0] != "person"])
def test_every_heavy_and_urban_kind_fills_its_box(name):
    """Along and across; what sticks out over it, like mirrors and eaves, by less than a tenth. Persons who stand are
    narrower than those who stride."""
    draw = next(entry[-1] for entry in (*HEAVY, *URBAN) if entry[0] == name)
    for seed in range(5):
        corners = draw(np.random.default_rng(seed)).corners.reshape(-1, 3)
        assert (np.abs(corners[:, :2]).max(axis=0) > 0.34).all()
        assert (np.abs(corners[:, :2]) < 0.6).all()
        assert corners[:, 2].min() >= 0.0
        assert 0.5 < corners[:, 2].max() < 1.2


def test_some_views_are_low_and_reach_the_horizon(ground):
    rng = np.random.default_rng(1)
    views = [_random_view(ground, rng, SIDE) for _ in range(200)]
    low = [v for v in views if v.p_enu[2] < 12.0]
    assert len(low) > 5
    assert any(not np.isfinite(ray_ground(v, [0.5 * v.width, 0.0])).all() for v in low)


def test_slots_lie_on_what_is_paved(ground):
    """The yard shows asphalt or concrete, which is nearly grey, where vehicles are to stand."""
    window, s = ground.window, ground.slots
    u, v = (s.x / window.m_per_px).astype(int), (-s.y / window.m_per_px).astype(int)
    side = window.levels[0].shape[0]
    inside = (u > 4) & (v > 4) & (u < side - 4) & (v < side - 4)
    patches = np.stack(
        [
            window.levels[0][b - 4 : b + 4, a - 4 : a + 4].mean(axis=(0, 1))
            for a, b in zip(u[inside], v[inside], strict=True)
        ]
    )
    assert np.median(np.ptp(patches, axis=1)) < 45


def test_a_catalogue_has_a_model_for_each_kind(catalogue):
    style = random_style(np.random.default_rng(0), catalogue)
    assert set(style.models) == {FIRST_KIND + k for k in range(len(catalogue))}
    assert {s.group for s in catalogue} == {"road", "rover", "clutter"}
    assert all(0.05 < s.size[0] < 40.0 for s in catalogue)


def test_every_kind_of_the_table_can_be_drawn():
    rng = np.random.default_rng(2)
    style = random_style(rng)
    assert set(style.models) == set(SIZES) - {OCCLUDER}
    renderer = Renderer(random_scene(rng), style, seed=1)
    kinds = np.array(sorted(SIZES), np.int8)
    size = np.array([[np.mean(r) for r in SIZES[int(k)]] for k in kinds]).T
    x = 14.0 * (np.arange(len(kinds)) % 6 - 2.5)
    y = 12.0 * (np.arange(len(kinds)) // 6 - 1.0)
    view = camera(height=70.0, size=(900, 700), focal=600.0)
    things = Bodies(
        kind=kinds,
        x=x,
        y=y,
        heading=0.0 * x,
        length=size[0],
        width=size[1],
        height=size[2],
        color=np.full((len(kinds), 3), (30, 30, 220), np.uint8),
    )
    image = renderer.draw(view, things)
    assert image.shape == (700, 900, 3)
    corner = ray_ground(view, [[0.0, 0.0], [900.0, 700.0]])
    assert (np.abs(x) < corner[:, 0].max() + 5).all()


@pytest.mark.parametrize("seed", range(12))
def test_footage_keeps_size_and_place(seed):
    """Whatever happens to an image, a bright square on dark ground stays where it is."""
    image = np.full((128, 160, 3), 60, np.uint8)
    image[40:72, 56:104] = 220
    out = as_footage(image, np.random.default_rng(seed))
    assert out.shape == image.shape and out.dtype == np.uint8
    grey = out.astype(float).mean(axis=2)
    assert grey[44:68, 60:100].mean() > grey[:30].mean() + 15
    middle = 0.5 * (grey[44:68, 60:100].mean() + grey[90:].mean())
    v, u = np.nonzero(grey > middle)
    assert abs(np.median(u) - 79.5) < 8 and abs(np.median(v) - 55.5) < 8
