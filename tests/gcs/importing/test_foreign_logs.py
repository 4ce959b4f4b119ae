"""Logs by pymavlink's and pyulog's own writers with the troubles that users report: read right, told, or refused."""

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import GcsError
from gcs.importing.sources import read_vehicle_logs
from mavlink.errors import MavlinkError
from tests.support.imports import foreign_logs
from tests.support.imports.straight import LAT, LON, STEP_US, T0_US

COUNT = 50
MOST_BYTES = 64_000_000
WITHIN_M = 0.05


def away_m(log):
    """Farthest from where the drive was at the times of the log."""
    at = (log.places.t_us - T0_US) / STEP_US
    north = np.abs(log.places.lat_deg - LAT[0] - LAT[1] * at) * 111_320.0
    east = np.abs(log.places.lon_deg - LON[0] - LON[1] * at) * 75_800.0
    return float(np.maximum(north, east).max())


@pytest.mark.slow
def test_no_log_is_read_wrong_without_a_word(tmp_path):
    command = [sys.executable, foreign_logs.__file__, str(tmp_path), str(COUNT)]
    subprocess.run(command, check=True, timeout=300, cwd=Path.cwd())
    logs = sorted(tmp_path.iterdir())
    assert len(logs) == COUNT
    right = told = refused = 0
    tracemalloc.start()
    for path in logs:
        tracemalloc.reset_peak()
        try:
            found = read_vehicle_logs(path)
        except (GcsError, MavlinkError) as error:
            assert "\n" not in str(error) and path.name in str(error)
            refused += 1
            found = []
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES, path.name
        for log in found:
            assert np.all(np.diff(log.places.t_us) > 0)
            words = [*log.notes.assumed, *log.notes.skipped]
            # rounding to milliseconds and 1e-7 degrees
            is_right = log.clock == "utc" and away_m(log) < WITHIN_M
            assert is_right or words, f"{path.name}: {away_m(log):.2f} m"
            right, told = right + (is_right and not words), told + bool(words)
    tracemalloc.stop()
    assert min(right, told, refused) > 4, (right, told, refused)
