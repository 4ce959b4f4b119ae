"""The station's screens: one widget per file, all drawing from `gcs.snapshot.Snapshot`.

`run` shows a station until the operator quits; `RollcallApp` is the app itself, for tests and embedding.
"""

from __future__ import annotations

import contextlib
import gc
import signal
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.report.rollcall import RollCall
from gcs.station import Station
from gcs.tui.app import RollcallApp
from gcs.tui.draw.pixels import Graphics
from gcs.tui.terminal.terminal_app import MAX_FPS
from gcs.tui.themes import ThemeName

if TYPE_CHECKING:
    from gcs.flight.listening import Listening
    from gcs.mission.roster import FleetChoice, Role

__all__ = ["Ended", "RollcallApp", "run", "run_start"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """The end of the screens."""

    code: int
    """0 after a quit, 1 when something of the station did not work or the screens broke."""
    left: bool
    """True: ended by the operator, or by a signal to end; else the screens broke or the terminal is gone."""


def run(
    station: Station,
    graphics: Graphics = "auto",
    *,
    bell: bool = False,
    theme: ThemeName = "dark",
    fps: float = MAX_FPS,
    calls: RollCall | None = None,
    to_end: Callable[[], bool] = lambda: False,
    hung_up: Callable[[], bool] = lambda: False,
) -> Ended:
    """Show a station until the operator quits; whoever started it stops it.

    Args:
        station: A running flight or replay.
        graphics: ``auto`` and ``pixels`` show real pixels where the terminal can, the others never ask it.
        bell: ring the terminal's bell at every new alarm.
        theme: colours to begin with.
        fps: most pictures a second of the video and the map.
        calls: who was named in a flight so far.
        to_end: asked time and again whether to end as if the operator had quit.
        hung_up: asked time and again, by another thread, whether to end as if the terminal were gone.
    """
    # what is loaded by now stays; walking through it costs the screen 0.1 s at every full collection
    gc.freeze()
    app = RollcallApp(station, graphics=graphics, bell=bell, theme=theme, fps=fps, calls=calls)
    app.to_end, app.hung_up = to_end, hung_up
    with _handlers_kept():
        app.run()
    return Ended(code=app.return_code or 0, left=app.left)


def run_start(
    listening: Listening,
    chosen: Mapping[int, Role],
    *,
    whole_fleet: bool,
    video: str | None,
    theme: ThemeName,
    to_end: Callable[[], bool],
    hung_up: Callable[[], bool],
) -> FleetChoice | None:
    """Show who is heard until the operator flies, or quits: None. As of :class:`gcs.tui.start_app.StartApp`."""
    from gcs.tui.start_app import StartApp

    app = StartApp(listening, chosen, whole_fleet=whole_fleet, video=video, theme=theme)
    app.to_end, app.hung_up = to_end, hung_up
    with _handlers_kept():
        app.run()
    return app.found


@contextlib.contextmanager
def _handlers_kept() -> Iterator[None]:
    """Textual's handlers of these signals outlive its screens, and would draw on a terminal that they have left."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTSTP, signal.SIGCONT, signal.SIGWINCH)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
