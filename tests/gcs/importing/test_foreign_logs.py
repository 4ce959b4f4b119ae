"""Logs by pymavlink's and pyulog's own writers with the troubles that users report: right, told, or refused."""

import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import GcsError
from gcs.importing.camera_choice import CameraOptions
from gcs.importing.importer import ImportOptions, import_flight
from mavlink.errors import MavlinkError
from mavlink.tlog.log import Tlog
from tests.support.imports import foreign_logs
from tests.support.imports.straight import FILES, LAT, LON, STEP_US, T0_US, Straight

COUNT = 50
MAX_BYTES = 64_000_000
WITHIN_M = 0.05
FILM = Path("tests/data/reported/grey_film.mp4")


def away_m(session):
    """Farthest from where the drive was at the times of the session's telemetry."""
    log = Tlog.open(session / "telemetry.tlog")
    rows, wire = log.columns(33, 11)
    at = (log.index.t_us[rows] - T0_US) / STEP_US
    north = np.abs(wire["lat"] * 1e-7 - LAT[0] - LAT[1] * at) * 111_320.0
    east = np.abs(wire["lon"] * 1e-7 - LON[0] - LON[1] * at) * 75_800.0
    return float(np.maximum(north, east).max())


@pytest.mark.slow
def test_no_log_is_imported_wrong_without_a_word(tmp_path):
    command = [sys.executable, foreign_logs.__file__, str(tmp_path / "logs"), str(COUNT)]
    (tmp_path / "logs").mkdir()
    subprocess.run(command, check=True, timeout=300, cwd=Path.cwd())
    logs = sorted((tmp_path / "logs").iterdir())
    assert len(logs) == COUNT
    above = Straight()
    above.alt_m = above.alt_m + 30.0
    uav, right, told, refused = tmp_path / "uav.csv", 0, 0, 0
    uav.write_text(FILES["rover.csv"](above))
    usual = ImportOptions(video=FILM, uav=uav, clock_s=0.0, camera=CameraOptions(fov_deg=70.0))
    tracemalloc.start()
    for path in logs:
        tracemalloc.reset_peak()
        session = tmp_path / f"session-{path.name}"
        options = replace(usual, ugv=(f"11={path}",))
        try:
            report = import_flight(session, options)
        except (GcsError, MavlinkError) as error:
            # one that was cut short does not cover the film
            assert "\n" not in str(error) and (path.name in str(error) or "while the fleet reports" in str(error))
            refused += 1
            continue
        assert tracemalloc.get_traced_memory()[1] < MAX_BYTES, path.name
        (account,) = (each for each in report.sources if each.role == "ugv 11")
        words = [*account.assumed, *account.left_out]
        # rounding to milliseconds and 1e-7 degrees
        is_right = away_m(session) < WITHIN_M
        assert is_right or words, f"{path.name}: {away_m(session):.2f} m"
        right, told = right + (is_right and not words), told + bool(words)
    tracemalloc.stop()
    assert min(right, told, refused) > 4, (right, told, refused)
