"""Pictures of the screens at five moments, in every size, theme and depth of colour, to be looked at.

    python -m bench.screens.pictures pictures
    python -m bench.screens.pictures pictures --moments quiet "40 vehicles" --sizes 80x24 --depths standard

The flights are ``bench.flights``' own, filmed by the simulator; each is shown a while after its trouble began.
"""

from __future__ import annotations

import argparse
import asyncio
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

from PIL import Image
from rich.color import Color
from textual.app import App

import gcs.tui
from bench.flights import FlightScript, Moment, Span, polls_of
from bench.screens.__main__ import script_of, size_of
from bench.screens.cast import INK, PAPER, draw, fonts_of
from bench.screens.screen import BACKGROUND, BLANK, FOREGROUND, Cell
from bench.screens.station import ScriptedStation
from gcs.station import Station
from gcs.tui import RollcallApp
from gcs.tui.themes import THEMES, Depth, ThemeName
from sim.world.scenario import ScenarioFault
from tests.support.fake_station import FakeTimeline

SIZES: Final = ((80, 24), (120, 40), (160, 48), (200, 60))
DEPTHS: Final[tuple[Depth, ...]] = ("truecolor", "256", "standard")
ANALYSED: Final = 0.4
"""Share of the replay that is analysed where a place after it is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureScene:
    """A moment, and the keys that show what matters in it."""

    script: FlightScript
    keys: tuple[str, ...] = ("down", "down")
    replayed: bool = False
    """True for a replay of the flight at a place that is not analysed."""


def _script(name: str, no_video: tuple[Span, ...] = (), **parts: Any) -> FlightScript:  # noqa: ANN401
    return script_of(name, seconds=14.0, fps=10.0, injected={"rendered": True, "no_video": no_video}, **parts)


LIES: Final = ScenarioFault(vehicle=1, kind="jump", start_s=9.0, stop_s=99.0, size=40.0)
SCENES: Final = {
    "quiet": PictureScene(script=_script("quiet")),
    "lying": PictureScene(script=_script("lying", faults=(LIES,))),
    "no video": PictureScene(script=_script("no video", no_video=((8.0, 99.0),))),
    "40 vehicles": PictureScene(script=_script("40 vehicles", vehicles=40, ground="open", silent={20: (6.0, 99.0)})),
    "not analysed": PictureScene(script=_script("not analysed"), keys=(), replayed=True),
}


class _ShownApp(RollcallApp):
    """The app in a terminal of this many colours."""

    CSS_PATH = str(Path(gcs.tui.__file__).with_name("app.tcss"))

    def __init__(self, station: Station, theme: ThemeName, depth: Depth) -> None:
        self._depth = depth
        super().__init__(station, graphics="blocks", theme=theme)
        self.silent_after_s = math.inf  # a moment stands still

    @property
    def colours(self) -> str | None:
        return self._depth


class ReplayedStation(ScriptedStation):
    """A replay that is paused where its analysis has not come by yet."""

    def __init__(self, moment: Moment) -> None:
        shown = replace(moment.snapshot, analysed=False, vehicles=(), boxes=(), alarms=())
        super().__init__(replace(moment, snapshot=shown))
        self.title, self.timeline = f"{ANALYSED:.0%} analysed", FakeTimeline()
        start_us, lasted_us = shown.now_us - 300_000_000, 400_000_000
        self.timeline.start_us, self.timeline.stop_us = start_us, start_us + lasted_us
        self.timeline.now_us = shown.now_us
        self.timeline.analysed = [(start_us, start_us + round(ANALYSED * lasted_us))]


def cells_of(app: App[None]) -> list[list[Cell]]:
    """The screen of a running app, in the colours of a usual terminal."""
    rows = []
    for strip in app.screen._compositor.render_strips()[: app.size.height]:
        row = []
        for segment in strip:
            look: list[str] = []
            if (style := segment.style) is not None:
                ink, paper = (style.bgcolor, style.color) if style.reverse else (style.color, style.bgcolor)
                look = [_sgr(FOREGROUND, ink, INK), _sgr(BACKGROUND, paper, PAPER), *(["1"] if style.bold else [])]
            row += [Cell(letter, tuple(look)) for letter in segment.text]
        rows.append([*row, *[BLANK] * app.size.width][: app.size.width])
    return rows


def _sgr(place: str, colour: Color | None, default: tuple[int, int, int]) -> str:
    red, green, blue = default if colour is None or colour.is_default else colour.get_truecolor()
    return f"{place};2;{red};{green};{blue}"


async def picture_of(
    scene: PictureScene, moment: Moment, size: tuple[int, int], theme: ThemeName, depth: Depth
) -> Image.Image:
    """One screen."""
    station = ReplayedStation(moment) if scene.replayed else ScriptedStation(moment)
    app = _ShownApp(station, theme, depth)
    async with app.run_test(size=size) as pilot:
        await pilot.press(*scene.keys)
        app._poll()
        await pilot.pause()
        await pilot.pause()
        return draw(cells_of(app), fonts_of())


async def write(scenes: Iterable[str], options: argparse.Namespace) -> None:
    """Fly each scene once, and draw its last moment in all ways."""
    for name in scenes:
        moment = polls_of(SCENES[name].script)[-1]
        for (columns, rows), theme, depth in product(options.sizes, options.themes, options.depths):
            image = await picture_of(SCENES[name], moment, (columns, rows), theme, depth)
            words = (name.replace(" ", "-"), f"{columns}x{rows}", theme, depth)
            image.save(options.out / f"{'_'.join(words)}.png")
        print(name, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the pictures")
    parser.add_argument("--moments", nargs="*", choices=SCENES, default=list(SCENES), help="some of them")
    parser.add_argument("--sizes", nargs="*", type=size_of, default=SIZES, help="columns and rows, 80x24")
    parser.add_argument("--themes", nargs="*", choices=THEMES, default=list(THEMES))
    parser.add_argument("--depths", nargs="*", choices=DEPTHS, default=list(DEPTHS), help="colours of the terminal")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    asyncio.run(write(options.moments, options))


if __name__ == "__main__":
    main()
