"""Elevation files for tests."""

import numpy as np
from PIL import Image, TiffImagePlugin

AREA, POINT = 1, 2


def write_geotiff(path, z, corner, cell, *, epsg=4326, raster=AREA, no_data=None, keys=(), **save):
    """A north-up grid.

    Args:
        path: of the file.
        z: (rows, columns) elevations, the north first.
        corner: x and y of the first cell's corner, or of its centre where ``raster`` is ``POINT``.
        cell: width and height of one.
        epsg: of its coordinates; degrees for 4326, else of a projection.
        raster: what the tie point is of.
        no_data: value of cells without an elevation.
        keys: more of its keys, (id, value).
    """
    kind = 2 if epsg == 4326 else 1
    place = [(1024, kind), (1025, raster), (2048 if kind == 2 else 3072, epsg), *keys]
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550] = (*cell, 0.0)
    tags.tagtype[33550] = 12
    tags[33922] = (0.0, 0.0, 0.0, *corner, 0.0)
    tags.tagtype[33922] = 12
    flat = [1, 1, 0, len(place)]
    for key, value in sorted(place):
        flat += [key, 0, 1, value]
    tags[34735] = tuple(flat)
    tags.tagtype[34735] = 3
    if no_data is not None:
        tags[42113] = str(no_data)
        tags.tagtype[42113] = 2
    Image.fromarray(np.asarray(z)).save(path, "TIFF", tiffinfo=tags, **save)
    return path
