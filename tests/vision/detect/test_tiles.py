"""Tiles: they cover an image, and a vehicle at a seam is seen once."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.detect.detections import Detections
from vision.detect.tiles import detect_in_tiles, tile_grid

LENGTH = 16


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 900), st.integers(1, 900), st.integers(64, 400), st.integers(64, 400), st.integers(0, 60))
def test_tiles_cover_the_image_and_are_no_larger_than_allowed(width, height, wide, high, overlap):
    tiles = tile_grid((width, height), (wide, high), overlap)
    covered = np.zeros((height, width), bool)
    for tile in tiles:
        assert 0 <= tile.left < tile.right <= width and 0 <= tile.top < tile.bottom <= height
        assert tile.right - tile.left <= wide and tile.bottom - tile.top <= high
        covered[tile.top : tile.bottom, tile.left : tile.right] = True
    assert covered.all()
    assert len(tiles) == 1 or (width, height) > (wide, high) or width > wide or height > high


def test_tiles_are_no_larger_than_needed():
    assert {tile.right - tile.left for tile in tile_grid((150, 40), (100, 100), 20)} == {85}


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(64, 200))
def test_every_vehicle_is_seen_whole_and_once(seed, side):
    rng = np.random.default_rng(seed)
    # vehicles apart from each other on a jittered grid, shown as one bright pixel at the centre
    grid = np.stack(np.meshgrid(np.arange(24, 480, 48), np.arange(24, 300, 48)), axis=-1).reshape(-1, 2)
    centres = grid + rng.integers(-12, 13, grid.shape)
    image = np.zeros((300, 500, 3), np.uint8)
    image[centres[:, 1], centres[:, 0]] = 255

    def detect(parts):
        return [found(part) for part in parts]

    def found(part):
        """A vehicle cut by the part's edge is seen as the half that is left, elsewhere than it is."""
        y, x = np.nonzero(part[:, :, 0])
        low, high = np.maximum(x - LENGTH / 2, 0), np.minimum(x + LENGTH / 2, part.shape[1])
        cut = np.full(len(x), 10.0)
        return Detections(
            cx=(low + high) / 2, cy=y, w=high - low, h=cut, angle=0 * cut, score=0.05 * cut, heading=np.nan * cut
        )

    tiles = tile_grid((500, 300), (side, side), 2 * LENGTH)
    seen = detect_in_tiles(image, tiles, detect)
    assert sorted(map(tuple, seen.centre.tolist())) == sorted(map(tuple, centres.astype(float).tolist()))
    assert set(seen.w.tolist()) == {float(LENGTH)}


def test_nothing_seen_is_nothing():
    tiles = tile_grid((300, 300), (100, 100), 10)
    seen = detect_in_tiles(np.zeros((300, 300, 3), np.uint8), tiles, lambda parts: [Detections.empty() for _ in parts])
    assert len(seen) == 0
