"""The picture in cells: half blocks, sextants, octants, 256 colours; and what is chosen for which terminal."""

from __future__ import annotations

import base64
import io
import os
import pty
import threading
import unicodedata

import numpy as np
import pytest
from PIL import Image
from rich.color import Color
from rich.console import Console
from textual.geometry import Region

from gcs.tui import RollcallApp
from gcs.tui import app as app_module
from gcs.tui.draw.mosaic import OCTANTS, SEXTANTS, PictureMode, mosaic_of
from gcs.tui.draw.pixels import Pixels, _inline_widget, _shows_inline, inline_image, picture_mode
from gcs.tui.draw.terminal_kind import ask_version, finest_grain
from gcs.tui.draw.video_canvas import video_cells
from gcs.tui.draw.xterm_palette import FIRST, GREYS_OF_SIXTEEN, PALETTE, dithered, in_four_greys, nearest
from tests.support.fake_station import FakeStation, comes_true, make_snapshot

MODES = [
    PictureMode(grain=grain, depth=depth)
    for grain in ("halves", "sextants", "octants")
    for depth in ("truecolor", "256")
]
HIGH = {"halves": 2, "sextants": 3, "octants": 4}


def channels(packed):
    return np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=-1)


def painted(mosaic, grain):
    """What a terminal shows of it: (high · rows, 2 · columns, 3) RGB."""
    letters = {"sextants": SEXTANTS, "octants": OCTANTS}.get(grain)
    high, (rows, columns) = HIGH[grain], mosaic.letter.shape
    image = np.zeros((high * rows, 2 * columns, 3))
    for row in range(rows):
        for column in range(columns):
            ink, paper = channels(mosaic.ink[row, column]), channels(mosaic.paper[row, column])
            if letters is None:
                image[2 * row, 2 * column : 2 * column + 2], image[2 * row + 1, 2 * column : 2 * column + 2] = (
                    ink,
                    paper,
                )
                continue
            pattern = int(np.flatnonzero(letters == mosaic.letter[row, column])[0])
            for part in range(2 * high):
                where = high * row + part // 2, 2 * column + part % 2
                image[where] = ink if pattern >> part & 1 else paper
    return image


def test_sextants_are_those_of_unicode():
    assert len(set(SEXTANTS.tolist())) == 64
    for pattern, letter in enumerate(SEXTANTS.tolist()):
        if letter >= 0x1FB00:
            digits = "".join(str(part + 1) for part in range(6) if pattern >> part & 1)
            assert unicodedata.name(chr(letter)) == f"BLOCK SEXTANT-{digits}"


def test_octants_are_those_of_unicode():
    """Samples of the block's names list, which Python's own tables do not have yet."""
    assert len(set(OCTANTS.tolist())) == 256
    for digits, letter in (
        ("3", 0x1CD00), ("23", 0x1CD01), ("4", 0x1CD03), ("12345", 0x1CD17), ("6", 0x1CD18), ("146", 0x1CD20),
        ("23456", 0x1CD35), ("17", 0x1CD36), ("357", 0x1CD48), ("12457", 0x1CD4D), ("1234567", 0x1CD70),
        ("18", 0x1CD71), ("168", 0x1CD90), ("12468", 0x1CD98), ("178", 0x1CDAC), ("1345678", 0x1CDE4),
        ("2345678", 0x1CDE5), ("13", ord("▘")), ("5678", ord("▄")), ("1357", ord("▌")), ("12345678", ord("█")),
        ("345678", ord("▆")), ("", ord(" ")),
    ):  # fmt: skip
        assert OCTANTS[sum(1 << int(digit) - 1 for digit in digits)] == letter, digits


@pytest.mark.parametrize("mode", MODES, ids=str)
def test_a_picture_in_cells_is_like_the_image(mode):
    small = np.zeros((HIGH[mode.grain] * 6, 2 * 10, 3), dtype=np.uint8)
    small[:] = (60, 120, 200)
    small[3 * HIGH[mode.grain] :, 4:] = (200, 90, 30)
    mosaic = mosaic_of(small, 10, 6, mode)
    shown = painted(mosaic, mode.grain)[..., ::-1]
    assert mosaic.letter.shape == mosaic.ink.shape == mosaic.paper.shape == (6, 10)
    rough = 60.0 if mode.depth == "256" else 16.0
    assert np.abs(shown[4 * HIGH[mode.grain] :, 8:].mean(axis=(0, 1)) - (200, 90, 30)).max() < rough
    assert np.abs(shown[: 2 * HIGH[mode.grain]].mean(axis=(0, 1)) - (60, 120, 200)).max() < rough


@pytest.mark.parametrize(("grain", "error"), [("sextants", 0.0), ("octants", 0.0)])
def test_a_cell_shows_the_shape_of_what_is_in_it(grain, error):
    """Every pattern of two colours comes back as it was, whatever letter it takes."""
    high, letters = HIGH[grain], {"sextants": SEXTANTS, "octants": OCTANTS}[grain]
    for pattern in range(1, len(letters) - 1):
        parts = np.array([220 if pattern >> part & 1 else 30 for part in range(2 * high)], dtype=np.uint8)
        image = np.repeat(parts.reshape(high, 2)[..., None], 3, axis=-1)
        mosaic = mosaic_of(image, 1, 1, PictureMode(grain=grain))
        assert mosaic.letter[0, 0] == letters[pattern]
        assert channels(mosaic.ink[0, 0]).min() > 200 and channels(mosaic.paper[0, 0]).max() < 50


def test_noise_makes_no_pattern():
    image = np.full((30, 20, 3), 100, dtype=np.uint8) + np.random.default_rng(1).integers(0, 4, (30, 20, 3), np.uint8)
    assert set(mosaic_of(image, 10, 10, PictureMode(grain="sextants")).letter.ravel()) == {ord(" ")}


def test_the_palette_is_that_of_xterm():
    for number in (16, 17, 21, 46, 67, 196, 231, 232, 243, 255):
        assert tuple(PALETTE[number - FIRST]) == tuple(Color.from_ansi(number).get_truecolor())
        red, green, blue = PALETTE[number - FIRST].tolist()
        assert nearest(red << 16 | green << 8 | blue) == number


def test_dithered_colours_are_of_the_palette_and_nearer_on_the_average_than_any_one_is():
    known = {red << 16 | green << 8 | blue for red, green, blue in PALETTE.tolist()}
    errors = []
    for bgr in np.random.default_rng(3).integers(0, 256, (60, 3)):
        packed = dithered(np.full((40, 40, 3), bgr, dtype=np.uint8))
        assert set(packed.ravel().tolist()) <= known
        blue, green, red = bgr.tolist()
        one = PALETTE[nearest(red << 16 | green << 8 | blue) - FIRST][::-1]
        mean = channels(packed).mean(axis=(0, 1))[::-1]
        errors.append((np.abs(mean - bgr).mean(), np.abs(one - bgr).mean()))
    dither, single = np.mean(errors, axis=0)
    assert dither < single


@pytest.mark.parametrize("meadow", [(32, 80, 84), (45, 95, 95), (35, 95, 85), (50, 100, 110)])
def test_a_dithered_meadow_has_next_to_no_red_or_green_points(meadow):
    rng = np.random.default_rng(3)
    bgr = meadow + rng.normal(0, 14, (40, 40, 1)) + rng.normal(0, 3, (40, 40, 3))
    shown = channels(dithered(np.clip(bgr, 0, 255).astype(np.uint8)))
    red, green, _ = np.moveaxis(shown, -1, 0)
    assert (np.abs(red - green) >= 40).mean() < 0.03


@pytest.mark.parametrize("grey", [12, 60, 131, 200, 236])
def test_greys_stay_grey_and_as_bright(grey):
    shown = channels(dithered(np.full((40, 40, 3), grey, dtype=np.uint8)))
    assert (np.ptp(shown, axis=-1) == 0).all() and abs(shown.mean() - grey) < 1.0


def test_a_terminal_of_256_colours_is_sent_no_other():
    snapshot = make_snapshot()
    for grain in HIGH:
        mode = PictureMode(grain=grain, depth="256")
        strips = video_cells(snapshot, 12, 60, 18, mode=mode).strips()
        for strip in strips:
            for segment in strip:
                assert segment.style.color.number >= FIRST and segment.style.bgcolor.number >= FIRST
        sent = "".join(strip.render(Console(color_system="256", force_terminal=True)) for strip in strips)
        assert "38;5;" in sent and "38;2;" not in sent
        assert all(strip.cell_length == 60 for strip in strips)


@pytest.mark.parametrize(
    ("environ", "reply", "grain"),
    [
        ({}, "", "halves"),
        ({}, "kitty(0.40.1)", "octants"),
        ({}, "kitty(0.39.9)", "sextants"),
        ({}, "foot(1.20.2)", "octants"),
        ({}, "ghostty 1.1.3", "sextants"),
        ({}, "WezTerm 20240203-110809-5046fc22", "sextants"),
        ({}, "XTerm(390)", "halves"),
        ({}, "tmux 3.4", "halves"),
        ({}, "kitty(\u0663\u0664)", "halves"),
        ({"VTE_VERSION": "7802"}, "", "octants"),
        ({"VTE_VERSION": "7600"}, "", "sextants"),
        ({"VTE_VERSION": "x"}, "", "halves"),
        ({"TERM_PROGRAM": "ghostty", "TERM_PROGRAM_VERSION": "1.2.3"}, "", "octants"),
        ({"VTE_VERSION": "7802", "TMUX": "/tmp/tmux-0/default,1,0"}, "", "halves"),
        ({"TERM": "screen-256color", "TERM_PROGRAM": "WezTerm"}, "", "halves"),
    ],
)
def test_the_grain_of_known_terminals(environ, reply, grain):
    assert finest_grain(environ, lambda: reply) == grain


@pytest.mark.parametrize(
    ("reply", "version"),
    [
        (b"\x1bP>|kitty(0.40.1)\x1b\\\x1b[?62;c", "kitty(0.40.1)"),
        (b"\x1b[?1;2c", ""),
        (b"", ""),
    ],
)
def test_the_terminal_is_asked_and_nothing_of_its_reply_is_left_to_be_read(reply, version, monkeypatch):
    monkeypatch.setattr("gcs.tui.terminal.question.WAIT_S", 0.3 if reply else 0.02)
    keeper, child = pty.openpty()
    asked = []

    def answer():
        asked.append(os.read(keeper, 100))
        os.write(keeper, reply)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        assert ask_version(child, child) == version
        thread.join(5)
        assert asked and asked[0].startswith(b"\x1b[>0q")
        os.set_blocking(child, False)
        with pytest.raises(BlockingIOError):
            os.read(child, 1)
    finally:
        os.close(keeper)
        os.close(child)


def test_what_the_user_wants_is_not_asked():
    assert picture_mode("sextants", "truecolor") == PictureMode(grain="sextants")
    assert picture_mode("octants", "256") == PictureMode(grain="octants", depth="256")
    assert picture_mode("blocks", "256") == PictureMode(depth="256")
    assert picture_mode("auto", "truecolor") == PictureMode(), "there is no terminal here"


def test_an_inline_image_is_a_picture_of_its_own_size_for_iterm2():
    shown = inline_image(Image.fromarray(np.full((40, 60, 3), (10, 200, 30), dtype=np.uint8)))
    head, _, data = shown.removesuffix("\x07").partition(":")
    assert head.startswith("\x1b]1337;File=inline=1;") and "width=60px;height=40px" in head
    image = Image.open(io.BytesIO(base64.b64decode(data)))
    assert image.size == (60, 40) and image.getpixel((30, 20))[1] > 190
    assert f"size={len(base64.b64decode(data))};" in head


async def test_the_inline_image_is_drawn_where_the_video_is(monkeypatch):
    pixels = Pixels(widget=_inline_widget(), cell_width=10, cell_height=20)
    monkeypatch.setattr(app_module, "pixel_images", lambda graphics: pixels)
    async with RollcallApp(FakeStation(), graphics="pixels").run_test(size=(100, 30)) as pilot:
        pixels = pilot.app.query_one("#pixels")
        assert await comes_true(pilot, lambda: pixels.children and pixels.children[0].size.area)
        (coded,) = pixels.children
        *_, last = coded.render_lines(Region(0, 0, *coded.size))
        place, image, _ = (segment.text for segment in last)
        assert image.startswith("\x1b]1337;File=inline=1;")
        assert place == f"\x1b[{coded.region.y + 1};{coded.region.x + 1}H"


def test_inline_images_are_for_those_who_show_them():
    assert _shows_inline({"TERM_PROGRAM": "iTerm.app"})
    assert not _shows_inline({"TERM_PROGRAM": "iTerm.app", "TMUX": "x"})
    assert not _shows_inline({"TERM_PROGRAM": "Apple_Terminal"}) and not _shows_inline({})


def test_sixteen_colours_show_a_flat_picture_in_more_than_one_grey():
    ramp = np.repeat(np.linspace(60, 110, 40).astype(np.uint8)[None, :, None], 20, axis=0).repeat(3, axis=2)
    greys = in_four_greys(ramp)
    assert len(set(greys.ravel().tolist())) >= 2 and set(greys.ravel().tolist()) <= set(GREYS_OF_SIXTEEN.tolist())
    assert (greys[:, -1] & 255).mean() > (greys[:, 0] & 255).mean()
