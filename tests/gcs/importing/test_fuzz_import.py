"""Every reader on files that are cut, shuffled, flipped, in another encoding or full of hostile numbers.

It tells what is there or says in one line why it cannot; what it tells can be sent.
"""

import re

import numpy as np
import pytest

from gcs.errors import GcsError
from gcs.importing.film_log import read_film_log
from gcs.importing.messages import vehicle_records
from gcs.importing.sources import read_vehicle_logs
from mavlink.errors import MavlinkError
from mavlink.protocol.framing import Framer
from tests.support.imports.film_writers import with_klv, with_sei, with_subtitles
from tests.support.imports.flown import fly
from tests.support.imports.log_writers import dataflash, gpx, pose_csv, positions_csv, ulog
from tests.support.imports.srt_writers import LAYOUTS, srt
from tests.support.imports.text_writers import dataflash_text, kml, nmea
from vision.errors import VisionError

NUMBERS = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"-0",
    b"9" * 400,
    b"0x1f",
    b"1_0",
    "١٢".encode(),
    b"",
    b"181",
    b"-91",
    b"1e18",
]
TEXTS = ("srt", "csv", "gpx", "kml", "nmea", "log")
SEEDS = range(25)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """A whole file of each kind."""
    folder = tmp_path_factory.mktemp("flown")
    flown = fly(folder, 12)
    spots = flown.spots()
    films = {
        "ts": with_klv(flown, folder / "klv.ts"),
        "sei.mp4": with_sei(flown, folder / "sei.mp4"),
        "siyi.mkv": with_subtitles(flown, folder / "siyi.mkv", "siyi"),
    }
    return {
        **{f"{layout}.srt": srt(layout, spots).encode() for layout in LAYOUTS},
        "positions.csv": positions_csv(flown, (11, 12)).encode(),
        "pose.csv": pose_csv(flown).encode(),
        "rovers.gpx": gpx(flown, (11, 12)).encode(),
        "rovers.kml": kml(flown, (11, 12)).encode(),
        "rover.nmea": nmea(flown, 11).encode(),
        "rover.log": dataflash_text(dataflash(flown, 11, gimbal_deg=(0.0, -45.0, 10.0))).encode(),
        "rover.bin": dataflash(flown, 11, gimbal_deg=(0.0, -45.0, 10.0)),
        "rover.ulg": ulog(flown, 11),
        "uav.tlog": (flown.session / "telemetry.tlog").read_bytes()[:40_000],
        **{name: path.read_bytes() for name, path in films.items()},
    }


NAMES = (
    *(f"{layout}.srt" for layout in LAYOUTS),
    *(
        "positions.csv",
        "pose.csv",
        "rovers.gpx",
        "rovers.kml",
        "rover.nmea",
        "rover.log",
        "rover.bin",
        "rover.ulg",
        "uav.tlog",
        "ts",
        "sei.mp4",
        "siyi.mkv",
    ),
)


def flipped(data, rng, at, size):
    changed = bytearray(data)
    for place in rng.integers(len(data), size=20).tolist():
        changed[place] ^= int(rng.integers(1, 256))
    return bytes(changed)


def shuffled(data, rng, at, size):
    lines = data.splitlines(keepends=True)
    return b"".join(lines[k] for k in rng.permutation(len(lines)).tolist())


def renumbered(data, rng, at, size):
    hostile = [
        found if rng.random() < 0.9 else NUMBERS[rng.integers(len(NUMBERS))]
        for found in re.findall(rb"\d+\.?\d*", data)
    ]
    return b"".join(part for pair in zip(re.split(rb"\d+\.?\d*", data), [*hostile, b""], strict=True) for part in pair)


def recoded(data, rng, at, size):
    encoding = ["utf-16", "utf-16-be", "cp1252", "utf-7"][rng.integers(4)]
    return data.decode("utf-8", "replace").encode(encoding, "replace")


MISHAPS = [
    lambda data, rng, at, size: data[:at],
    lambda data, rng, at, size: data[at:],
    flipped,
    lambda data, rng, at, size: data[:at] + bytes(size) + data[at + size :],
    lambda data, rng, at, size: data[: at + size] + data[at:],
    lambda data, rng, at, size: data[at:] + data[:at],
]
OF_TEXTS = [shuffled, renumbered, recoded, renumbered]


def spoilt(data, name, seed):
    """The file after some mishaps."""
    rng = np.random.default_rng(seed)
    mishaps = MISHAPS + OF_TEXTS * name.endswith(TEXTS)
    for k in rng.integers(len(mishaps), size=rng.integers(1, 4)).tolist():
        if data:
            data = mishaps[k](data, rng, int(rng.integers(len(data))), int(rng.integers(1, 400)))
    return data


def read(path):
    if path.suffix in (".ts", ".mp4", ".mkv"):
        log, _ = read_film_log(path, coarse=True)
        return [] if log is None else [log]
    return read_vehicle_logs(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_whatever_a_file_holds(name, samples, tmp_path):
    told = refused = 0
    for seed in SEEDS:
        path = tmp_path / f"{seed}.{name}"
        path.write_bytes(spoilt(samples[name], name, seed))
        try:
            logs = read(path)
        except (GcsError, MavlinkError, VisionError) as error:
            refused += 1
            assert "\n" not in str(error)
            assert str(seed) in str(error)
            continue
        for log in logs:
            told += 1
            assert len(log.places) > 0
            assert np.all(np.diff(log.places.t_us) > 0)
            records = vehicle_records(log, 1, 0 if log.clock == "utc" else 10**15, flies=True, home_m=100.0)
            frames = Framer().receive_bytes(b"".join(raw for _, raw in records))
            assert len(frames) == len(records)
    # most mishaps make a film none
    assert told > (0 if name.endswith(("mp4", "mkv")) else 3)
    assert refused > 0


@pytest.mark.slow_but_first
@pytest.mark.parametrize("name", NAMES)
def test_whole_files_are_read_whole(name, samples, tmp_path):
    path = tmp_path / f"whole.{name}"
    path.write_bytes(samples[name])
    assert all(not log.notes.skipped for log in read(path))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("suffix", ["srt", "csv", "gpx", "kml", "nmea", "log", "bin", "ulg"])
@pytest.mark.parametrize("data", [b"\0" * 100_000, b"\xff" * 100_000, b"1" * 1_000_000, b"\n" * 100_000, b"<" * 10_000])
def test_long_nonsense(suffix, data, tmp_path):
    path = tmp_path / f"nonsense.{suffix}"
    path.write_bytes(data)
    with pytest.raises(GcsError, match="nonsense") as caught:
        read_vehicle_logs(path)
    assert len(str(caught.value)) < 400


def test_years_between_two_rows_cost_nothing(tmp_path):
    path = tmp_path / "years.csv"
    path.write_text("time_us,lat,lon\n1000,1.5,2.5\n" + "".join(f"{4 * 10**15 + k},1.5,2.5\n" for k in range(3)))
    (log,) = read_vehicle_logs(path)
    assert log.notes.skipped == {"positions a day from the others": 1}
    assert len(vehicle_records(log, 1, 0, flies=False, home_m=0.0)) < 20
