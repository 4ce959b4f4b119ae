from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import get_args

import numpy as np
import pytest
from rich.cells import cell_len

from gcs.cli import screen_options
from gcs.snapshot import Alarm, Standing
from gcs.tui import RollcallApp
from gcs.tui.draw.map_canvas import STANDING_MARKS
from gcs.tui.draw.xterm_palette import FIRST, PALETTE, SIXTEEN
from gcs.tui.palette import LINE, ink, standing_colour, use_depth, use_theme
from gcs.tui.themes import THEMES, Colour, ThemeName
from tests.support.fake_station import SMALL, WIDE, FakeStation, comes_true, make_snapshot

BACKGROUNDS = (Colour.PANEL, Colour.HEAD, Colour.PICKED, Colour.ALARM_TINT, Colour.WARN_TINT)
READABLE = 4.5
"""WCAG 2.2, contrast of text, level AA."""
VISIBLE = 3.0
"""The same, of lines and marks."""
PLAIN_TO_SEE = 0.07
"""Least distance of two colours in Oklab; side by side 0.02 is just seen."""

# severity 1.0 of Machado, Oliveira and Fernandes 2009, doi:10.1109/TVCG.2009.113, on linear RGB
EYES = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
# linear RGB to cones and on to Oklab: Ottosson 2020, https://bottosson.github.io/posts/oklab/
CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def linear(rgb):
    share = np.asarray(rgb, dtype=float) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def contrast(a, b):
    light, dark = sorted((float(linear(each) @ (0.2126, 0.7152, 0.0722)) for each in (a, b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def oklab(rgb, eye):
    return OKLAB @ np.cbrt(CONES @ np.clip(EYES[eye] @ linear(rgb), 0.0, 1.0))


@pytest.fixture(autouse=True)
def dark_again():
    yield
    use_theme("dark")
    use_depth("truecolor")


def test_the_command_line_offers_what_there_is():
    assert get_args(screen_options.ThemeName) == get_args(ThemeName) == tuple(THEMES)
    assert all(set(theme.colours) == set(Colour) for theme in THEMES.values())
    assert {standing_colour(standing) for standing in get_args(Standing)} <= set(Colour)


TERMINALS = {"truecolor": None, "256": PALETTE, "standard": SIXTEEN}
"""What each colour of a terminal looks like, by its number: of 256 from the seventeenth on."""


def shown(colour, depth):
    """What the terminal shows of one of Rich's colours."""
    if depth == "truecolor":
        return tuple(colour.triplet)
    return tuple(TERMINALS[depth][colour.number - (FIRST if depth == "256" else 0)])


@pytest.mark.parametrize("depth", TERMINALS)
@pytest.mark.parametrize("name", THEMES)
def test_every_text_can_be_read_on_every_background(name, depth):
    use_theme(name)
    use_depth(depth)
    least = 7.0 if name == "high-contrast" and depth == "truecolor" else READABLE
    for colour in set(Colour) - {*BACKGROUNDS, Colour.GAP, LINE}:
        for paper in BACKGROUNDS:
            style = ink(colour, paper)
            assert contrast(shown(style.color, depth), shown(style.bgcolor, depth)) >= least, (colour, paper)
    for paper in (Colour.PANEL, Colour.HEAD):
        style = ink(LINE, paper)
        assert contrast(shown(style.color, depth), shown(style.bgcolor, depth)) >= VISIBLE


@pytest.mark.parametrize("name", THEMES)
def test_of_sixteen_colours_sure_doubtful_and_without_a_place_are_three(name):
    numbers = [THEMES[name].number(Colour(each), "standard") for each in ("confirmed", "tentative", "no position")]
    assert len(set(numbers)) == 3


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("name", THEMES)
def test_standings_differ_for_colour_blind_eyes_too(name, eye):
    colours = THEMES[name].colours
    # where a misplaced vehicle is nobody knows either, and it has a mark and a word of its own
    for one, other in combinations(set(get_args(Standing)) - {"misplaced"}, 2):
        seen = [oklab(colours[standing_colour(each)], eye) for each in (one, other)]
        assert np.linalg.norm(seen[0] - seen[1]) >= PLAIN_TO_SEE, (one, other)


def is_text(letter):
    """Neither blank, nor a part of the picture, nor braille, nor an emoji, which has colours of its own."""
    return not letter.isspace() and letter not in "▀▄" and not 0x2800 <= ord(letter) < 0x2900 and ord(letter) < 0x1F000


def unreadable(app, region=None, depth="truecolor"):
    """Texts of the screen, or of a region of it, whose contrast is too low; lines and blocks less strictly."""
    found = set()
    for y, row in enumerate(app.screen._compositor.render_strips()):
        x = 0
        for text, style, _ in row:
            letters = {letter for letter in text if is_text(letter)}
            inside = region is None or region.contains(x, y)
            x += cell_len(text)
            if not letters or not inside:
                continue
            assert style.color and style.bgcolor, text
            ink, paper = shown(style.color, depth), shown(style.bgcolor, depth)
            drawn = all(0x2500 <= ord(letter) < 0x25A0 for letter in letters)
            if contrast(ink, paper) < (VISIBLE if drawn else READABLE):
                found.add((text, ink, paper))
    return found


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", [(60, 20), SMALL, WIDE])
@pytest.mark.parametrize("name", THEMES)
@pytest.mark.parametrize("depth", TERMINALS)
async def test_every_text_on_the_screen_can_be_read(monkeypatch, depth, name, size):
    """Gutters, tints, the picked row and names on the picture too, one of them doubted."""
    monkeypatch.setattr(RollcallApp, "colours", depth)
    alarms = [
        Alarm(
            key=level, level=level, kind="", text=level, advice="", since_us=0, system_id=each, doubts_name=each == 12
        )
        for level, each in (("alarm", 12), ("alarm", 17), ("warning", 13))
    ]
    troubled = replace(make_snapshot(live=True), alarms=tuple(alarms))
    for station in (FakeStation(), FakeStation(live=True, snapshot=troubled)):
        app = RollcallApp(station, graphics="blocks", theme=name)
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            assert not unreadable(app, depth=depth)
            await pilot.press("down", "down", "down")
            assert not unreadable(app, depth=depth)
            await pilot.press("a", "2")
            assert not unreadable(app, depth=depth)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", THEMES)
@pytest.mark.parametrize(
    ("key", "box"),
    [
        ("ctrl+p", "CommandList"),
        ("ctrl+p", "CommandPalette #--input"),
        ("question_mark", "#help"),
        ("q", "LeaveFlight > Vertical"),
        ("m", "#ask"),
    ],
)
async def test_what_is_laid_over_the_panes_can_be_read(name, key, box):
    app = RollcallApp(FakeStation(live=True), graphics="blocks", theme=name)
    async with app.run_test(size=SMALL) as pilot:
        await pilot.press(key)
        assert await comes_true(pilot, lambda: app.screen.query(box) and app.screen.query_one(box).region.area > 0)
        await pilot.pause()
        assert not unreadable(app, app.screen.query_one(box).region)


async def test_a_key_changes_the_theme_of_all_that_is_on_screen():
    app = RollcallApp(FakeStation(), graphics="blocks")
    async with app.run_test(size=WIDE, notifications=True) as pilot:
        await pilot.pause()
        for name in ("light", "high-contrast", "dark"):
            await pilot.press("t")
            await pilot.pause()
            assert app.theme == name
            papers = {
                tuple(style.bgcolor.triplet)
                for row in app.screen._compositor.render_strips()
                for text, style, _ in row
                if "▀" not in text and style and style.bgcolor and style.bgcolor.triplet
            }
            assert THEMES[name].colours[Colour.PANEL] in papers
            other = THEMES["light" if name != "light" else "dark"].colours
            assert other[Colour.HEAD] not in papers


async def test_without_colours_words_and_marks_tell_the_same(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    app = RollcallApp(FakeStation(), graphics="blocks")
    async with app.run_test(size=WIDE) as pilot:
        await pilot.pause()
        said = "\n".join("".join(text for text, *_ in row) for row in app.screen._compositor.render_strips())
        fleet = app.query_one("#fleet")
        shown = {
            style.color.triplet
            for strip in fleet.render_lines(fleet.region.reset_offset)
            for _, style, _ in strip
            if style and style.color and style.color.triplet
        }
        assert shown and all(red == green == blue for red, green, blue in shown)
        for word in ("confirmed", "tentative", "coasting", "unknown", "out of view", "no position", "stale", "lost"):
            assert word in said, word
        assert all(mark in said for mark in STANDING_MARKS.values() if mark not in "◎≠")
