from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim.render.exposure import Exposure
from sim.render.ground import Ground, GroundStyle
from sim.render.render import SKY, Renderer, Style, body_outline
from sim.world.bodies import PAINT, Block, Model, crate
from sim.world.view import OCCLUDER, OTHER_VEHICLE, UGV, Bodies, CameraView, Road, Scene, project, ray_ground

PLAIN = GroundStyle(side_px=1024)
STILL = Exposure(noise=0.0, vignette=0.0)
MAGENTA = (255, 0, 255)


def camera(pitch_deg=-90.0, yaw=0.0, p_enu=(0.0, 0.0, 40.0), size=(640, 360), focal=400.0, distortion=(0.0,) * 5):
    pitch = np.radians(pitch_deg)
    forward = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    R_enu_cam = np.column_stack([right, np.cross(forward, right), forward])
    return CameraView(
        width=size[0],
        height=size[1],
        fx=focal,
        fy=focal,
        cx=size[0] / 2,
        cy=size[1] / 2,
        distortion=np.array(distortion),
        R_enu_cam=R_enu_cam,
        p_enu=np.array(p_enu, dtype=float),
    )


def bodies(*rows, color=MAGENTA):
    return Bodies.from_rows(rows, [color] * len(rows))


def test_the_same_arguments_give_the_same_pixels():
    scene = Scene(roads=(Road(centre=np.stack([np.linspace(-40, 40, 81), np.zeros(81)], axis=1), width=7.0, lanes=2),))
    things = bodies((UGV, 2, 3, 0.4, 2.2, 1.4, 0.9), (OCCLUDER, -4, 2, 0, 4, 4, 5))
    style = Style(ground=PLAIN)
    first, again = (Renderer(scene, style, seed=3) for _ in range(2))
    frames = [first.draw(camera(), things, 5), first.draw(camera(), things, 6), again.draw(camera(), things, 5)]
    np.testing.assert_array_equal(frames[0], frames[2])
    assert (frames[0] != frames[1]).any()  # other noise in another frame
    assert (frames[0] != Renderer(scene, style, seed=4).draw(camera(), things, 5)).any()


VIEWS = {
    "straight down": camera(),
    "turned": camera(yaw=2.0),
    "oblique": camera(-50.0, 0.7, (-15.0, -25.0, 30.0)),
    "distorted": camera(distortion=(-0.2, 0.05, 0.001, -0.001, 0.0)),
}


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS.keys())
def test_a_body_is_drawn_where_it_projects_to(view):
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: crate(inset=0.0, lid=PAINT)})
    flat = bodies((UGV, 3.0, 4.0, 0.6, 4.0, 2.0, 0.02))
    image = Renderer(Scene(), style).draw(view, flat).astype(int)
    v, u = np.nonzero((image[..., 0] > 150) & (image[..., 1] < 60) & (image[..., 2] > 150))
    assert len(u) > 50
    # the mean over the body's area, as perspective shows its near half larger
    forward, right = np.array([np.sin(0.6), np.cos(0.6), 0.0]), np.array([np.cos(0.6), -np.sin(0.6), 0.0])
    a, b = np.meshgrid(np.linspace(-1.95, 1.95, 40), np.linspace(-0.95, 0.95, 20))
    uv, _ = project(view, np.array([3.0, 4.0, 0.02]) + a[..., None] * forward + b[..., None] * right)
    weight = (
        1.0
        / np.linalg.norm(
            np.array([3.0, 4.0, 0.0]) + a[..., None] * forward + b[..., None] * right - view.p_enu, axis=-1
        )
        ** 3
    )
    want = (uv * weight[..., None]).sum(axis=(0, 1)) / weight.sum()
    np.testing.assert_allclose([u.mean() + 0.5, v.mean() + 0.5], want, atol=0.3)


def test_a_body_far_from_the_optical_axis_is_drawn():
    """An image cut from the side of a wider one shows what its middle shows."""
    view = replace(camera(focal=1600.0, p_enu=(-15.0, 4.0, 40.0)), cx=-400.0)
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: crate(inset=0.0, lid=PAINT)})
    image = Renderer(Scene(), style).draw(view, bodies((UGV, 3.0, 4.0, 0.6, 4.0, 2.0, 0.02))).astype(int)
    assert image[180, 320, 0] > 150 and image[180, 320, 1] < 60


def test_ground_stays_where_it_is_when_the_camera_moves():
    renderer = Renderer(Scene(), Style(ground=PLAIN, exposure=STILL))
    none = bodies()
    here = renderer.draw(camera(p_enu=(0.0, 0.0, 40.0)), none).astype(int)
    there = renderer.draw(camera(p_enu=(3.0, 0.0, 40.0)), none).astype(int)  # 3 m at 10 px/m
    assert np.abs(here[:, 30:] - there[:, :-30]).max() <= 2
    assert np.abs(here - there).mean() > 2


def test_windows_of_ground_agree_where_they_overlap():
    line = np.stack([np.linspace(-80, 80, 161), 0.2 * np.linspace(-80, 80, 161)], axis=1)
    scene = Scene(roads=(Road(centre=line, width=7.0, lanes=2),))
    ground = Ground(scene, PLAIN, np.random.default_rng(0))
    a, b = ground.around(0.0, 0.0, 10.0), ground.around(20.0, 20.0, 10.0)
    assert (a.west, a.north) != (b.west, b.north)
    shift = round((b.west - a.west) / a.m_per_px)
    differs = (a.levels[0][:-shift, shift:] != b.levels[0][shift:, :-shift]).any(axis=-1)
    assert differs.mean() < 1e-4  # the ends of drawn lines, where a window cuts them
    assert ground.around(0.5, 0.5, 10.0) is a


def test_a_tree_hides_what_stands_below_it():
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: crate(inset=0.0, lid=PAINT)})
    renderer = Renderer(Scene(), style)
    box = (UGV, 0.0, 0.0, 0.0, 2.2, 1.4, 0.9)

    def painted(things):
        image = renderer.draw(camera(), things).astype(int)
        return int(((image[..., 0] > 150) & (image[..., 1] < 60)).sum())

    assert painted(bodies(box, (OCCLUDER, 0.0, 0.0, 0.0, 6.0, 6.0, 6.0))) < 0.2 * painted(bodies(box))


def test_shadows_fall_away_from_the_sun():
    style = Style(ground=PLAIN, exposure=STILL, sun_azimuth=np.pi / 2, sun_elevation=0.7, shadow=0.6)  # sun in the east
    renderer = Renderer(Scene(), style)
    lit, none = (
        renderer.draw(camera(), b).astype(int) for b in (bodies((OTHER_VEHICLE, 0, 0, 0, 4, 2, 1.5)), bodies())
    )
    west, east = (slice(170, 190), slice(298, 306)), (slice(170, 190), slice(334, 342))
    assert lit[west].mean() < 0.6 * none[west].mean()
    assert lit[east].mean() > 0.95 * none[east].mean()


def test_the_sky_lies_above_the_horizon():
    view = camera(-5.0, p_enu=(0.0, 0.0, 20.0))
    image = Renderer(Scene(), Style(ground=PLAIN, exposure=STILL)).draw(view, bodies((UGV, 0, 60, 0, 2.2, 1.4, 0.9)))
    above = np.isnan(ray_ground(view, [[320.0, 2.0], [320.0, 350.0]])).any(axis=1)
    assert above.tolist() == [True, False]
    np.testing.assert_array_equal(image[2, 320], SKY)
    assert (image[350, 320] != SKY).any()


def test_an_image_with_nothing_but_sky():
    image = Renderer(Scene(), Style(ground=PLAIN, exposure=STILL)).draw(camera(60.0), bodies())
    assert (image == SKY).all()


def rounded(corner):
    return Model.of(Block(x=(-0.5, 0.5), y=(-0.5, 0.5), z=(0.0, 1.0), corner=corner))


def test_round_corners_take_off_what_their_ellipse_leaves():
    """With half its sides as axes of the corners, a box is an octagon in an ellipse: √½ of its area."""
    area = {}
    for corner in ((0.0, 0.0), (0.5, 0.5)):
        style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: rounded(corner)})
        image = Renderer(Scene(), style).draw(camera(), bodies((UGV, 0.0, 0.0, 0.3, 8.0, 4.0, 0.02))).astype(int)
        area[corner] = int(((image[..., 0] > 150) & (image[..., 1] < 60)).sum())
    assert area[0.5, 0.5] / area[0.0, 0.0] == pytest.approx(np.sqrt(0.5), abs=0.02)


def test_rounded_walls_are_lit_by_where_they_face():
    """Seen aslant from the south with the sun there, the near wall of a round box is brighter than in the shade."""
    bright = []
    for azimuth in (np.pi, 0.0):
        style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, sun_azimuth=azimuth, sun_elevation=0.4, ambient=0.4,
                      models={UGV: rounded((0.2, 0.2))})  # fmt: skip
        view = camera(-30.0, 0.0, (0.0, -20.0, 12.0))
        image = Renderer(Scene(), style).draw(view, bodies((UGV, 0.0, 0.0, 0.0, 4.0, 4.0, 3.0), color=(90, 60, 90)))
        (u, v), _ = project(view, [0.0, -2.0, 1.5])
        bright.append(int(image[int(v), int(u)].astype(int).sum()))
    assert bright[0] > 1.5 * bright[1]


def test_a_colour_of_minus_k_is_k_times_the_bodys():
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: crate(inset=0.02, lid=(-0.5, -0.5, -0.5))})
    image = Renderer(Scene(), style).draw(camera(), bodies((UGV, 0.0, 0.0, 0.0, 4.0, 4.0, 0.02), color=(200, 100, 40)))
    np.testing.assert_allclose(image[180, 320], (100, 50, 20), atol=1)


def test_wide_penumbras_soften_shadows_and_contact_darkens_the_ground_about_a_body():
    box = bodies((OTHER_VEHICLE, 0, 0, 0, 4, 2, 1.5))

    def drawn(**look):
        style = Style(ground=PLAIN, exposure=STILL, sun_azimuth=np.pi / 2, sun_elevation=0.7, **look)
        return Renderer(Scene(), style).draw(camera(focal=1600.0), box).astype(int)

    hard, soft = drawn(shadow=0.6), drawn(shadow=0.6, penumbra_m=1.5)
    row = slice(178, 182)
    steepest = [np.abs(np.diff(image[row, :230].mean(axis=(0, 2)))).max() for image in (hard, soft)]
    assert steepest[1] < 0.6 * steepest[0]
    east = slice(362, 368)  # just beyond the sunny side, at 40 px/m
    assert drawn(shadow=0.0, contact=0.6)[row, east].mean() < 0.85 * drawn(shadow=0.0)[row, east].mean()


def test_outlines_hold_the_body():
    view = camera(-50.0, 0.7, (-15.0, -25.0, 30.0))
    things = bodies((UGV, 2.0, 1.0, 0.5, 4.0, 2.0, 1.5))
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0, models={UGV: crate(inset=0.02, lid=PAINT)})
    renderer = Renderer(Scene(), style)
    changed = (renderer.draw(view, things) != renderer.draw(view, bodies())).any(axis=-1)
    v, u = np.nonzero(changed)
    outline = body_outline(view, things, 0)
    assert u.min() + 1 >= outline[:, 0].min() - 1 and u.max() <= outline[:, 0].max() + 1
    assert v.min() + 1 >= outline[:, 1].min() - 1 and v.max() <= outline[:, 1].max() + 1


def test_models_have_a_front():
    """No vehicle looks the same turned about: its image, turned by half a turn, differs clearly."""
    style = Style(ground=PLAIN, exposure=STILL, shadow=0.0)
    renderer = Renderer(Scene(), style)
    for kind, size in ((UGV, (2.2, 1.4, 0.9)), (OTHER_VEHICLE, (4.5, 1.8, 1.5))):
        image = renderer.draw(camera(focal=1200.0), bodies((kind, 0, 0, 0, *size), color=(60, 140, 60)))
        part = image[130:230, 290:350].astype(int)
        assert np.abs(part - part[::-1, ::-1]).mean() > 10


def test_a_canopy_covers_the_rectangle_that_hides_in_the_truth():
    renderer = Renderer(Scene(), Style(ground=PLAIN, exposure=STILL, shadow=0.0))
    view, tree = camera(), (OCCLUDER, 2.0, 1.0, 0.5, 9.0, 4.0, 6.0)
    changed = (renderer.draw(view, bodies(tree)) != renderer.draw(view, bodies())).any(axis=-1)
    v, u = np.mgrid[0 : view.height, 0 : view.width] + 0.5
    offset = ray_ground(view, np.stack([u, v], axis=-1), 6.0)[..., :2] - (2.0, 1.0)
    ahead, right = offset @ (np.sin(0.5), np.cos(0.5)), offset @ (np.cos(0.5), -np.sin(0.5))
    inside = (np.abs(ahead) < 4.5) & (np.abs(right) < 2.0)
    assert (changed & inside).sum() > 0.93 * inside.sum()
    assert (changed & ~inside).sum() < 0.12 * inside.sum()
