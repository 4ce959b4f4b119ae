"""Random roads over open ground, and random colours of both."""

from __future__ import annotations

import numpy as np

from sim.render.ground import GroundStyle
from sim.render.ground_canvas import near
from sim.world.view import Road, Scene


def random_scene(rng: np.random.Generator) -> Scene:
    """Draw a scene of up to four roads that cross open ground of a hundred metres, or none."""
    roads = []
    for _ in range(int(rng.choice([0, 1, 2, 3, 4]))):
        bearing, offset, bend = rng.uniform(0.0, np.pi), rng.uniform(-30.0, 30.0), rng.normal(0.0, 0.004)
        along = np.arange(-50.0, 50.0, 1.0)
        line = np.stack([along, offset + bend * along**2], axis=-1)
        c, s = np.cos(bearing), np.sin(bearing)
        lanes = int(rng.integers(1, 5))
        roads.append(
            Road(centre=line @ np.array([[c, s], [-s, c]]), width=float(lanes * rng.uniform(2.6, 3.8)), lanes=lanes)
        )
    return Scene(roads=tuple(roads))


def random_ground(rng: np.random.Generator) -> GroundStyle:
    """Colours and roughness wider than any real ground's."""
    bases = [
        (62, 105, 92),
        (92, 122, 146),
        (136, 142, 146),
        (92, 90, 88),
        (150, 152, 154),
        (212, 216, 218),
        (56, 54, 54),
    ]
    colors = [near(base, 26, rng) for base in bases]
    if rng.random() < 0.25:  # snow, sand, or a paved yard in place of grass
        colors[0] = near(((225, 225, 225), (140, 180, 205), (120, 118, 116))[int(rng.integers(3))], 15, rng)
    return GroundStyle(
        colors=tuple(colors),
        contrast=float(rng.uniform(0.05, 0.7)),
        blotches=float(rng.uniform(0.02, 0.3)),
        soil_share=float(rng.uniform(0.0, 0.6)),
        marks=bool(rng.random() < 0.8),
        wear=float(rng.uniform(0.0, 1.0)),
        side_px=3584,
    )
