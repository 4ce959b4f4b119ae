"""The station's screens: one widget per file, all drawing from `gcs.snapshot.Snapshot`.

`run` shows a station until the operator quits; `RollcallApp` is the app itself, for tests and embedding.
"""

from __future__ import annotations

import gc

from gcs.station import Station
from gcs.tui.app import RollcallApp
from gcs.tui.pixels import Graphics

__all__ = ["RollcallApp", "run"]


def run(station: Station, graphics: Graphics = "auto", *, bell: bool = False) -> int:
    """Show a station until the operator quits, then stop it.

    Args:
        station: A running flight or replay.
        graphics: ``auto`` and ``pixels`` show real pixels where the terminal can, ``blocks`` never asks it.
        bell: ring the terminal's bell at every new alarm.

    Returns:
        0 after a quit, 1 when the station had stopped with an error or the screens broke.
    """
    # what is loaded by now stays; walking through it costs the screen 0.1 s at every full collection
    gc.collect()
    gc.freeze()
    try:
        app = RollcallApp(station, graphics=graphics, bell=bell)
        app.run()
    finally:
        station.stop()
    return app.return_code or 0
