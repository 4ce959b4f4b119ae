"""Your own export: one line for each second and vehicle, with who it is and where the video showed it.

python examples/own_export.py sitl_logs/ardupilot-swarm seen.txt
"""

from __future__ import annotations

import sys
from pathlib import Path

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from gcs.snapshot import Snapshot

SECOND_US = 1_000_000


class SeenExport:
    """Takes snapshots one after the other, as all exports do: ``write`` each, then ``close``."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("x", encoding="utf-8")  # never over what is there
        self._due_us = 0

    def write(self, snapshot: Snapshot) -> None:
        if snapshot.t_us < self._due_us:
            return
        self._due_us = snapshot.t_us + SECOND_US
        for box in snapshot.boxes:
            if box.system_id:  # 0 is unknown
                name, east_m, north_m = snapshot.name_of(box.system_id), *box.p_enu[:2]
                self._file.write(f"{snapshot.t_us} {name} {box.confidence:.2f} {east_m:.1f} {north_m:.1f}\n")

    def close(self) -> None:
        self._file.close()


def main(folder: str, out: str) -> None:
    analysis, export = Analysis(open_session(Path(folder))), SeenExport(Path(out))
    for snapshot in analysis.snapshots(images=False):
        export.write(snapshot)
    export.close()
    analysis.close()
    print(out)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
