from __future__ import annotations

import errno
import os
import pty
import select
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from textual.widgets import Static

from gcs.tui import RollcallApp
from gcs.tui import app as app_module
from gcs.tui.draw.pixels import Pixels, pixel_images
from tests.support.bundled import ROOT
from tests.support.fake_station import FakeStation, comes_true


class ImageStandIn(Static):
    """As much of textual-image's widget as the video pane touches."""

    image = None


SCRIPT = """
import sys
from tests.support.fake_station import FakeStation
from gcs.tui import run
station = FakeStation(live=True)
if sys.argv[1] == "crash":
    def broken():
        raise RuntimeError("broken station")
    station.latest = broken
if sys.argv[1] == "error":
    station.error = OSError("no such link [/x]")
ended = run(station, graphics="auto")
sys.exit(10 + ended.code + 20 * ended.left + 100 * station.stopped)
"""


def test_no_terminal_no_pixels(monkeypatch):
    for graphics in ("auto", "blocks", "pixels"):
        assert pixel_images(graphics) is None
    monkeypatch.setattr(sys, "__stdout__", None)
    assert pixel_images("pixels") is None


def test_an_image_for_the_terminal_is_red_green_blue():
    pixels = Pixels(widget=ImageStandIn, cell_width=10, cell_height=20)
    image = np.zeros((2, 3, 3), dtype=np.uint8)
    image[..., 2] = 200
    shown = pixels.to_widget(image)
    assert shown.size == (3, 2) and shown.getpixel((0, 0)) == (200, 0, 0)


async def test_pixel_mode_hands_the_drawn_image_to_the_image_widget(monkeypatch):
    pixels = Pixels(widget=ImageStandIn, cell_width=10, cell_height=20)
    monkeypatch.setattr(app_module, "pixel_images", lambda graphics: pixels)
    station = FakeStation()
    app = RollcallApp(station, graphics="pixels")
    async with app.run_test(size=(100, 30)) as pilot:
        await pilot.pause()
        image = app.query_one("#pixels")
        first = image.image
        assert first is not None
        assert first.width / first.height == pytest.approx(16 / 9, rel=0.02)
        assert image.region.y == app.query_one("#video").region.y + 1
        assert image.size.width <= app.query_one("#video").size.width
        station.snapshot = replace(station.snapshot, frame=2000)
        await pilot.press("down", "down", "z", "escape", "question_mark", "escape")
        assert await comes_true(pilot, lambda: image.image is not first)


def in_terminal(mode: str, keys: bytes, until: bytes) -> tuple[int, bytes]:
    """Run the screens in a pseudo terminal of 80×24, press keys once ``until`` is seen; exit code and all output."""
    keeper, child = pty.openpty()
    os.set_blocking(keeper, False)
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"}
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, mode], stdin=child, stdout=child, stderr=child, cwd=ROOT, env=environment
    )
    os.close(child)
    said, stop, pressed = b"", time.monotonic() + 120, False
    try:
        while time.monotonic() < stop:
            if select.select([keeper], [], [], 0.1)[0]:
                try:
                    said += os.read(keeper, 65536)
                except OSError as error:
                    if error.errno == errno.EIO:
                        break
            if not pressed and until in said and keys:
                pressed = True
                os.write(keeper, keys)
        code = process.wait(timeout=120)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
        os.close(keeper)
    return code, said


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("mode", "keys", "code", "last"),
    [
        ("quit", b"qq", 30, b""),
        ("error", b"q", 31, b"station stopped: no such link [/x]"),
        ("crash", b"", 11, b"broken station"),
    ],
)
def test_terminal_is_given_back(mode, keys, code, last):
    left, said = in_terminal(mode, keys, b"UGV-17")
    assert left == code
    assert b"\x1b[?1049h" in said
    _, after = said.rsplit(b"\x1b[?1049l", 1)
    assert b"\x1b[?25h" in after  # the cursor is back
    assert b"\x1b[?1049h" not in after and last in after
    if not last:
        assert not after.replace(b"\x1b", b"").strip(b"[?0123456789hl<u\r\n")
