"""Ground for training images: random lawns, fields, streets, car parks and squares, with their markings.

It is one image that repeats without end. Places where vehicles park or drive in order, bays and lanes, are given as
slots, so that parked rows and queues come about as they do in towns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.render.ground import Ground, GroundStyle, GroundWindow, blotches, halvings
from sim.render.ground_canvas import Color, Sheet, near
from sim.render.open_scene import random_ground, random_scene
from sim.world.view import FloatArray

OPEN_SHARE, DEPOT_SHARE = 0.3, 0.25
"""Share of grounds that are open, and of those that have depots; a choice."""
RAILS_SHARE = 0.15
"""Share of streets with a track for trams; a choice."""
NONE = np.zeros(0)
"""Column of no entries."""
SIDE_PX = 2048
"""Side of the image that repeats, 143 m at ``M_PER_PX``; a choice of variety against memory."""
M_PER_PX = 0.07
"""Resolution of the ground: a choice of detail against memory."""
WHITE, YELLOW, BLUE = (225, 228, 230), (60, 165, 215), (190, 150, 70)
"""BGR of road markings."""
GREEN_GROUND = ((62, 105, 92), (60, 95, 75), (75, 130, 130), (85, 120, 145), (95, 135, 165))
"""BGR of grass and shrubs, from lush to dry."""
BARE_GROUND = ((92, 122, 146), (136, 142, 146), (140, 180, 205), (120, 150, 170), (228, 226, 224))
"""BGR of soil, gravel, sand, dry earth and snow."""
PAVED_GROUND = ((95, 92, 90), (110, 108, 106), (128, 126, 124), (150, 152, 154), (175, 178, 180), (80, 76, 74))
"""BGR of asphalt and concrete, new and old."""
COLOURED_GROUND = ((85, 80, 160), (90, 110, 60), (120, 170, 110), (110, 120, 170))
"""BGR of painted or coated ground."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slots:
    """n places for vehicles."""

    x: FloatArray
    """(n,) metres east of the ground's corner."""
    y: FloatArray
    """(n,) metres north of it, negative."""
    heading: FloatArray
    """(n,) radians clockwise from north."""
    length: FloatArray
    """(n,) metres of room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingGround:
    """A painted ground, in place of ``sim.render.ground.Ground``."""

    window: GroundWindow
    slots: Slots
    street: float
    """Main direction, radians clockwise from north."""

    @property
    def period_m(self) -> float:
        """Side of the ground, after which it repeats."""
        return float(self.window.levels[0].shape[0] * self.window.m_per_px)

    @property
    def mean(self) -> FloatArray:
        """(3,) mean colour."""
        return np.asarray(self.window.levels[-1].mean(axis=(0, 1)), dtype=np.float64)

    def around(self, _x: float, _y: float, _radius: float) -> GroundWindow:
        """The image, from which what lies beyond follows by repeating it."""
        return self.window


def random_training_ground(rng: np.random.Generator) -> TrainingGround:
    """A random ground: open ground of sessions, or a town, some with depots; some towns have no streets either."""
    kind = rng.random()
    if kind < OPEN_SHARE:
        return _open_ground(rng)
    return _town(rng, depots=int(rng.integers(1, 6)) if kind > 1.0 - DEPOT_SHARE else 0)


def _open_ground(rng: np.random.Generator) -> TrainingGround:
    """A window of ``sim.render.ground``: roads over grass, soil and gravel, in its own colours or in others."""
    style = GroundStyle(side_px=SIDE_PX) if rng.random() < 0.4 else replace(random_ground(rng), side_px=SIDE_PX)
    window = Ground(random_scene(rng), style, rng).around(0.0, 0.0, 10.0)
    return TrainingGround(
        window=replace(window, west=0.0, north=0.0),
        slots=Slots(x=NONE, y=NONE, heading=NONE, length=NONE),
        street=float(rng.uniform(0.0, np.pi)),
    )


def _town(rng: np.random.Generator, depots: int) -> TrainingGround:
    """Lawns, fields, squares, streets, car parks and depots."""
    sheet = Sheet(SIDE_PX, M_PER_PX, *_ground(rng))
    street = float(rng.uniform(0.0, np.pi))
    slots: list[tuple[float, float, float, float]] = []
    for _ in range(int(rng.integers(1, 11))):
        _patch(sheet, street, rng)
    if rng.random() < 0.8:
        for _ in range(int(rng.choice([0, 1, 2, 3, 4], p=[0.15, 0.35, 0.25, 0.15, 0.1]))):
            slots += _street(sheet, street + 0.5 * np.pi * int(rng.integers(2)) + rng.normal(0.0, 0.1), rng)
        for _ in range(int(rng.integers(0, 7))):
            slots += _car_park(sheet, street, rng)
    for _ in range(depots):
        slots += _depot(sheet, street, rng)
    for _ in range(int(rng.integers(0, 60))):
        _trace(sheet, street, rng)
    light = blotches(SIDE_PX, float(rng.uniform(0.02, 0.16)), rng)
    image = sheet.textured(light, rng)
    table = np.array(slots).reshape(-1, 4).T
    # sheet: u to the east, v to the south
    places = Slots(x=table[0], y=-table[1], heading=table[2], length=table[3])
    window = GroundWindow(levels=halvings(image), m_per_px=M_PER_PX, west=0.0, north=0.0)
    return TrainingGround(window=window, slots=places, street=street)


def _ground(rng: np.random.Generator) -> tuple[Color, float]:
    """A colour, and how rough the ground is that has it."""
    kinds = (GREEN_GROUND, BARE_GROUND, PAVED_GROUND, COLOURED_GROUND)
    k = int(rng.choice(4, p=[0.4, 0.18, 0.36, 0.06]))
    color = near(kinds[k][int(rng.integers(len(kinds[k])))], 20, rng)
    return color, float(rng.uniform(0.3, 1.0) if k < 2 else rng.uniform(0.0, 0.25))


def _patch(sheet: Sheet, street: float, rng: np.random.Generator) -> None:
    """A lawn, field, square or path of another material, with or without a kerb."""
    (color, rough), centre = _ground(rng), rng.uniform(0.0, sheet.side_m, 2)
    angle = street + 0.5 * np.pi * int(rng.integers(2)) if rng.random() < 0.7 else rng.uniform(0.0, np.pi)
    if rng.random() < 0.6:
        long, wide = rng.uniform(4.0, 60.0), rng.uniform(2.0, 40.0)
        outline = sheet.rectangle(centre, angle, long, wide)
    else:
        turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        reach = rng.uniform(3.0, 25.0) * (1.0 + 0.25 * np.sin(turn * rng.integers(1, 5) + rng.uniform(0, 6)))
        outline = centre + np.stack([np.cos(turn), np.sin(turn)], axis=-1) * reach[:, None]
        long = wide = 20.0
    sheet.fill(outline, color, rough)
    if rng.random() < 0.4:
        kerb = near(WHITE if rng.random() < 0.3 else (150, 152, 154), 20, rng)
        sheet.lines([outline], kerb, rng.uniform(0.1, 0.4), closed=True)
    kind = rng.random()
    if kind < 0.25:  # furrows, vines, decking, corrugated sheets
        step, wide_m = rng.uniform(0.4, 3.0), rng.uniform(0.1, 0.8)
        sheet.stripes(centre, angle, (long, wide), step, wide_m, near(color, 35, rng))
    elif kind < 0.45:  # paving stones
        step = rng.uniform(0.6, 3.0)
        for turned in (0.0, 0.5 * np.pi):
            size = (long, wide) if turned == 0.0 else (wide, long)
            sheet.stripes(centre, angle + turned, size, step, 0.07, near(color, 18, rng))


def _street(sheet: Sheet, angle: float, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """A street with pavements, lanes, marks, a crossing; the slots of its lanes."""
    along = np.arange(-0.8, 0.8, 0.02) * sheet.side_m
    bend = rng.normal(0.0, 0.002) if rng.random() < 0.5 else 0.0
    offset = rng.uniform(-0.5, 0.5) * sheet.side_m
    forward, right = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    middle = 0.5 * sheet.side_m + along[:, None] * forward + (offset + bend * along**2)[:, None] * right
    lanes, lane_m = int(rng.choice([1, 2, 2, 3, 4, 6])), float(rng.uniform(2.7, 3.8))
    width, mark = lanes * lane_m, near(WHITE if rng.random() < 0.8 else YELLOW, 18, rng)
    asphalt = near(PAVED_GROUND[int(rng.integers(len(PAVED_GROUND)))], 15, rng)

    def beside(d: float) -> FloatArray:
        return np.asarray(middle + d * right)

    if rng.random() < 0.6:
        sheet.lines([middle], near((150, 155, 160), 25, rng), width + rng.uniform(1.5, 9.0), rough=0.2)
    sheet.lines([middle], near((165, 168, 170), 20, rng), width + 0.5, rough=0.1)
    sheet.lines([middle], asphalt, width, rough=0.1)
    if rng.random() < 0.15:
        red = int(rng.integers(lanes))
        sheet.lines([beside((red + 0.5) * lane_m - 0.5 * width)], near((85, 80, 150), 15, rng), lane_m, rough=0.1)
    both = 1 if lanes == 1 else lanes // 2 if rng.random() < 0.75 else lanes
    if rng.random() < RAILS_SHARE:
        _rails(sheet, beside(lane_m * (int(rng.integers(lanes)) + 0.5) - 0.5 * width), right, rng)
    if rng.random() < 0.85:
        _lane_marks(sheet, [beside(k * lane_m - 0.5 * width) for k in range(lanes + 1)], both, right, mark, rng)
    slots = []
    for lane in range(lanes):
        d = (lane + 0.5) * lane_m - 0.5 * width
        back = bool(lane < lanes - both)
        slots += _lane_slots(beside(d), back, rng)
        for _ in range(int(rng.integers(0, 5))):
            k = int(rng.integers(20, len(along) - 20))
            _sign(sheet, beside(d)[k], angle + (np.pi if back else 0.0), mark, rng)
    for _ in range(int(rng.integers(0, 3))):
        k = int(rng.integers(15, len(along) - 15))
        sheet.stripes(middle[k], angle, (rng.uniform(2.5, 5.0), width - 0.4), rng.uniform(0.8, 1.3), 0.5, mark)
        if rng.random() < 0.5:
            sheet.fill(sheet.rectangle(middle[k] + 4.5 * forward, angle, 0.4, width - 0.4), mark)
    return slots


def _rails(sheet: Sheet, line: FloatArray, right: FloatArray, rng: np.random.Generator) -> None:
    """A track of 1.435 m for trams, in the road or on a bed of its own."""
    if rng.random() < 0.5:
        sheet.lines([line], near((120, 122, 124) if rng.random() < 0.6 else (65, 105, 90), 20, rng), 2.6, rough=0.3)
    steel = near((70, 72, 76) if rng.random() < 0.6 else (170, 172, 176), 15, rng)
    sheet.lines([line - 0.72 * right, line + 0.72 * right], steel, 0.1)


def _lane_marks(
    sheet: Sheet, borders: list[FloatArray], both: int, right: FloatArray, mark: Color, rng: np.random.Generator
) -> None:
    """Edge lines, a double line where the directions meet, broken lines between the other lanes."""
    sheet.lines([borders[0] + 0.25 * right, borders[-1] - 0.25 * right], mark, 0.15)
    on, off, wide = rng.uniform(1.0, 5.0), rng.uniform(1.0, 8.0), float(rng.choice([0.15, 0.3, 0.5], p=[0.7, 0.2, 0.1]))
    for k, border in enumerate(borders[1:-1], start=1):
        if k == both:
            double = near(YELLOW if rng.random() < 0.5 else WHITE, 15, rng)
            sheet.lines([border - 0.15 * right, border + 0.15 * right], double, 0.12)
        else:
            sheet.dashes(border, on, off, mark, wide)


def _lane_slots(line: FloatArray, back: bool, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Places along a lane: a queue, or traffic that flows."""
    step = np.diff(line, axis=0)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
    slots, at = [], rng.uniform(0.0, 20.0)
    queue = bool(rng.random() < 0.35)
    while at < s[-1] - 10.0:
        room = rng.uniform(5.2, 8.0) if queue else rng.uniform(8.0, 45.0)
        if rng.random() < 0.04:
            queue, room = not queue, room + 6.0
        u, v = np.interp(at + 0.5 * room, s, line[:, 0]), np.interp(at + 0.5 * room, s, line[:, 1])
        k = min(int(np.searchsorted(s, at)), len(step) - 1)
        heading = float(np.arctan2(step[k, 0], -step[k, 1])) + (np.pi if back else 0.0)
        slots.append((float(u), float(v), heading + float(rng.normal(0.0, 0.03)), room - rng.uniform(0.5, 1.5)))
        at += room
    return slots


def _car_park(sheet: Sheet, street: float, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Rows of bays, their marks and signs; the slots of the bays."""
    centre, angle = rng.uniform(0.0, sheet.side_m, 2), street + 0.5 * np.pi * int(rng.integers(2))
    bays, rows = int(rng.integers(4, 22)), int(rng.integers(1, 5))
    bay_w, bay_l, aisle = rng.uniform(2.2, 2.8), rng.uniform(4.6, 5.6), rng.uniform(0.0, 6.5)
    slant = rng.uniform(-0.6, 0.6) if rng.random() < 0.2 else 0.0
    mark = near((WHITE, WHITE, WHITE, YELLOW, BLUE)[int(rng.integers(5))], 20, rng)
    forward, right = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    pitch = bay_l + aisle
    if rng.random() < 0.85:
        area = sheet.rectangle(centre, angle, rows * pitch + 5.0, bays * bay_w + 5.0)
        sheet.fill(area, near(PAVED_GROUND[int(rng.integers(len(PAVED_GROUND)))], 18, rng), rough=0.1)
    slots, lined, closed = [], rng.random() < 0.9, rng.random() < 0.5
    line_m, lettered = rng.uniform(0.08, 0.18), float(rng.choice([0.06, 0.8], p=[0.75, 0.25]))
    for row in range(rows):
        foot = centre + (row - 0.5 * rows) * pitch * forward - 0.5 * bays * bay_w * right
        lean = forward * bay_l + right * np.tan(slant) * bay_l
        edges = [np.stack([foot + k * bay_w * right, foot + k * bay_w * right + lean]) for k in range(bays + 1)]
        if lined:
            sheet.lines(edges, mark, line_m)
            if closed:
                sheet.lines([np.stack([foot, foot + bays * bay_w * right])], mark, line_m)
        for k in range(bays):
            u, v = foot + (k + 0.5) * bay_w * right + 0.5 * lean
            turn = np.pi if rng.random() < 0.5 else 0.0
            slots.append((float(u), float(v), angle + slant + turn + float(rng.normal(0.0, 0.03)), bay_l + 0.4))
            bay = sheet.rectangle(np.array([u, v]), angle + slant, bay_l, bay_w - 0.1)
            if rng.random() < lettered:
                _sign(sheet, np.array([u, v]), angle, near((WHITE, BLUE)[int(rng.integers(2))], 20, rng), rng)
            elif rng.random() < 0.03:
                sheet.fill(bay, _ground(rng)[0])
            elif rng.random() < 0.03:  # no parking: crossed out, or hatched
                sheet.lines([bay[[0, 2]], bay[[1, 3]]], mark, line_m)
                sheet.stripes(np.array([u, v]), angle + 0.7, (0.8 * bay_w, 0.6 * bay_l), 0.9, 0.2, mark)
    return slots


def _depot(sheet: Sheet, street: float, rng: np.random.Generator) -> list[tuple[float, float, float, float]]:
    """Rows of long bays side by side on one paved yard, all of a row the same way round, with or without lines."""
    centre, angle = rng.uniform(0.0, sheet.side_m, 2), street + 0.5 * np.pi * int(rng.integers(2))
    bays, rows = int(rng.integers(5, 25)), int(rng.integers(1, 4))
    bay_w, bay_l, aisle = rng.uniform(2.95, 4.2), rng.uniform(9.0, 19.0), rng.uniform(0.0, 16.0)
    slant = rng.uniform(-0.7, 0.7) if rng.random() < 0.3 else 0.0
    forward, right = np.array([np.sin(angle), -np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    pitch = bay_l + aisle
    yard = sheet.rectangle(centre, angle, rows * pitch + 12.0, bays * bay_w + 12.0)
    sheet.fill(yard, near(PAVED_GROUND[int(rng.integers(len(PAVED_GROUND)))], 18, rng), rough=0.1)
    mark, lined = near((WHITE, WHITE, YELLOW)[int(rng.integers(3))], 20, rng), rng.random() < 0.6
    slots = []
    for row in range(rows):
        foot = centre + (row - 0.5 * rows) * pitch * forward - 0.5 * bays * bay_w * right
        lean = forward * bay_l + right * np.tan(slant) * bay_l
        if lined:
            edges = [np.stack([foot + k * bay_w * right, foot + k * bay_w * right + lean]) for k in range(bays + 1)]
            sheet.lines(edges, mark, rng.uniform(0.1, 0.2))
        turn = np.pi if rng.random() < 0.5 else 0.0
        for k in range(bays):
            u, v = foot + (k + 0.5) * bay_w * right + 0.5 * lean
            slots.append((float(u), float(v), angle + slant + turn + float(rng.normal(0.0, 0.01)), bay_l + 0.5))
    return slots


def _sign(sheet: Sheet, at: FloatArray, heading: float, color: Color, rng: np.random.Generator) -> None:
    """An arrow, a word or a number on the ground."""
    forward, right = np.array([np.sin(heading), -np.cos(heading)]), np.array([np.cos(heading), np.sin(heading)])
    if rng.random() < 0.55:
        sheet.lines([np.stack([at - 2.0 * forward, at + 1.2 * forward])], color, 0.2)
        tip = at + 2.4 * forward + (rng.uniform(-1.0, 1.0) * right if rng.random() < 0.4 else 0.0)
        base = at + 1.0 * forward
        sheet.fill(np.stack([tip, base - 0.5 * right, base + 0.5 * right]), color)
    elif rng.random() < 0.5:
        size = (float(rng.uniform(0.8, 4.5)), float(rng.uniform(0.6, 2.0)))
        sheet.glyphs(int(rng.integers(1, 6)), at, heading, size, color, rng)
    else:
        letters = "".join(rng.choice(list("STOPBUSZONE0358KHXAEMNW"), int(rng.integers(1, 6))))
        sheet.text(letters, at, heading, rng.uniform(0.7, 2.4), color)


def _trace(sheet: Sheet, street: float, rng: np.random.Generator) -> None:
    """Something small: repair, lid, crack, stain, tyre tracks, puddle, drain, painted box."""
    at, kind = rng.uniform(0.0, sheet.side_m, 2), rng.random()
    grey = int(rng.uniform(35, 190))
    color = near((grey, grey, grey), 12, rng)
    angle = street + 0.5 * np.pi * int(rng.integers(2)) + rng.normal(0.0, 0.1)
    if kind < 0.25:
        sheet.fill(sheet.rectangle(at, angle, rng.uniform(0.4, 6.0), rng.uniform(0.3, 3.0)), color)
    elif kind < 0.4:
        turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
        reach = rng.uniform(0.25, 1.5)
        sheet.fill(at + reach * np.stack([np.cos(turn), rng.uniform(0.5, 1) * np.sin(turn)], axis=-1), color)
    elif kind < 0.6:
        walk = at + np.cumsum(rng.normal(0.0, 0.5, (int(rng.integers(5, 30)), 2)) + rng.normal(0.0, 0.5, 2), axis=0)
        sheet.lines([walk], near((60, 60, 60), 15, rng), rng.uniform(0.05, 0.15))
    elif kind < 0.75:
        turn = np.cumsum(rng.normal(0.0, 0.1, 30)) + rng.uniform(0.0, 6.3)
        track = at + np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=-1), axis=0)
        side = 0.8 * np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
        sheet.lines([track - side, track + side], near((70, 85, 95), 25, rng), rng.uniform(0.15, 0.35))
    elif kind < 0.85:
        outline = sheet.rectangle(at, angle, rng.uniform(2.0, 8.0), rng.uniform(1.5, 4.0))
        sheet.lines([outline], near(WHITE, 30, rng), 0.12, closed=True)
    elif kind < 0.93:
        _sign(sheet, at, angle, near(WHITE, 30, rng), rng)
    else:
        shape = at + rng.normal(0.0, 1.0, (6, 2)) * rng.uniform(0.3, 2.0)
        sheet.fill(shape, color, hull=True)
