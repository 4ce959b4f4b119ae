"""Images of others are decoded within bounds, or are none."""

import subprocess
import sys

import cv2
import numpy as np
import pytest

from vision.video.image_file import decoded

GREY = np.full((48, 64, 3), 77, np.uint8)
IN_A_PROCESS = """
import resource, sys
from vision.video.image_file import decoded
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
assert decoded(sys.stdin.buffer.read()) is None
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.parametrize("ending", [".png", ".jpg", ".webp", ".bmp", ".tiff"])
def test_a_good_image_is_read(ending):
    image = decoded(cv2.imencode(ending, GREY)[1].tobytes())
    assert image.shape == GREY.shape and abs(image.astype(int) - GREY).max() <= 3


@pytest.mark.parametrize("name", [b"IDAT", b"tEXt"])
def test_a_piece_that_says_it_has_gigabytes_takes_none(name):
    data = bytearray(cv2.imencode(".png", GREY)[1].tobytes())
    at = data.index(b"IDAT") - 4
    piece = (0x7F000000).to_bytes(4, "big") + name
    data = data[:at] + piece + data[at + 8 :] if name == b"IDAT" else data[:at] + piece + data[at:]
    taken = subprocess.run([sys.executable, "-c", IN_A_PROCESS], input=data, capture_output=True, check=True).stdout
    assert int(taken) < 100_000, "kilobytes"


def test_a_png_that_breaks_off_is_none():
    data = cv2.imencode(".png", GREY)[1].tobytes()
    assert [decoded(data[:-n]) for n in (1, 12, 40)] == [None, None, None]
