import dataclasses
import io
import json
import os
import re
from fractions import Fraction
from types import SimpleNamespace

import av
import klvdata
import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.export.motion_imagery.misb import SETS_KEY
from gcs.importing.film_log import read_film_log
from gcs.importing.formats.film_streams import _packets, _parts, read_streams
from gcs.importing.formats.klv import log_of_klv
from gcs.importing.formats.sei import TELEMETRY_UUID, log_of_messages, unregistered_messages
from gcs.importing.formats.siyi import siyi_log
from gcs.importing.formats.subtitles import SubtitleCue
from gcs.importing.formats.timed_bytes import TimedBytes
from mavlink.geodesy import rotation_from_euler
from tests.support.imports.film_writers import (
    bodies_deg,
    klv_set,
    sei_unit,
    siyi,
    telemetry,
    with_klv,
    with_sei,
    with_subtitles,
)
from tests.support.imports.flown import FOV_DEG, fly
from tests.support.imports.srt_writers import Spot
from vision.errors import VideoError

FRAMES = 40


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return fly(tmp_path_factory.mktemp("flown"), FRAMES)


def assert_follows(log, flown, *, within_deg, alt_m):
    """The log's places are those of the frames."""
    spots = flown.spots()
    assert len(log.places) == FRAMES
    t_us = np.array([t * 1e6 for t, _ in spots])
    assert log.places.t_us == pytest.approx(t_us, abs=2000)
    assert log.places.lat_deg == pytest.approx([spot.lat for _, spot in spots], abs=within_deg)
    assert log.places.lon_deg == pytest.approx([spot.lon for _, spot in spots], abs=within_deg)
    assert log.places.alt_m == pytest.approx([spot.alt for _, spot in spots], abs=alt_m)
    assert abs(log.zero_us - flown.frames_us[0]) < 2000


def test_klv_in_a_transport_stream(flown, tmp_path):
    video = with_klv(flown, tmp_path / "cam.ts")
    log, troubles = read_film_log(video, coarse=True)
    assert troubles == ()
    assert_follows(log, flown, within_deg=1e-7, alt_m=0.16)
    yaw = np.degrees(log.attitudes.angles[:, 2])
    assert (yaw - bodies_deg(flown)[:, 2] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.01)
    assert np.degrees(log.gimbal.angles[:, 1]) == pytest.approx(-90.0, abs=0.01)
    assert np.degrees(log.view.hfov) == pytest.approx(FOV_DEG, abs=0.01)


def test_what_we_write_is_klv_to_others(flown, tmp_path):
    with av.open(str(with_klv(flown, tmp_path / "cam.ts"))) as container:
        (stream,) = container.streams.data
        data = b"".join(bytes(packet) for packet in container.demux(stream))
    sets = list(klvdata.StreamParser(io.BytesIO(data)))
    assert len(sets) == FRAMES
    first = sets[0].MetadataList()
    assert float(first[13][3]) == pytest.approx(flown.spots()[0][1].lat, abs=1e-6)
    assert float(first[16][3]) == pytest.approx(FOV_DEG, abs=0.01)


@pytest.mark.parametrize("elevation_deg", [-90.0, -45.0, -20.0])
def test_platform_and_sensor_together(elevation_deg):
    spot, body_deg = Spot(50.0, 10.0, 300.0, 0.0, unix_us=10**15), (5.0, -3.0, 200.0)
    log = log_of_klv("cam.ts", [TimedBytes(0, klv_set(spot, body_deg, elevation_deg=elevation_deg))])
    wanted = rotation_from_euler(*np.radians(body_deg)) @ rotation_from_euler(0.0, np.radians(elevation_deg), 0.0)
    assert rotation_from_euler(*log.gimbal.angles[0]) == pytest.approx(wanted, abs=1e-3)


def test_klv_that_is_damaged():
    spot = Spot(50.0, 10.0, 300.0, 0.0, unix_us=10**15)
    good, next_one = (
        klv_set(dataclasses.replace(spot, unix_us=10**15 + late), (0.0, 0.0, 0.0)) for late in (0, 300_000)
    )
    wrong = bytearray(good)
    wrong[40] ^= 1
    packets = [TimedBytes(k * 100_000, data) for k, data in enumerate([good, bytes(wrong), good[:50], next_one + good])]
    log = log_of_klv("cam.ts", packets)
    assert log.notes.skipped == {
        "KLV sets with a wrong checksum": 1,
        "KLV sets that are cut": 1,
        "positions that are there twice": 1,
    }
    with pytest.raises(ImportFileError, match=r"cam\.ts.*1 KLV sets with a wrong checksum"):
        log_of_klv("cam.ts", packets[1:2])


@pytest.mark.parametrize("unix_us", [(1 << 64) - 1, (1 << 63) - 1, 5 * 10**15])
def test_a_date_that_cannot_be_is_not_known(unix_us):
    data = klv_set(Spot(50.0, 10.0, 300.0, 0.0, unix_us=unix_us), (0.0, 0.0, 0.0))
    log = log_of_klv("cam.ts", [TimedBytes(0, data), TimedBytes(100_000, data)])
    assert log.zero_us == 0 and log.places.t_us.tolist() == [0, 100_000]


def test_messages_among_the_pictures(flown, tmp_path):
    video = with_sei(flown, tmp_path / "cam.mp4")
    log, troubles = read_film_log(video, coarse=True)
    assert troubles == ()
    assert_follows(log, flown, within_deg=1e-7, alt_m=1e-6)
    assert log.places.height_m == pytest.approx([spot.height for _, spot in flown.spots()])
    assert np.degrees(log.attitudes.angles) == pytest.approx(bodies_deg(flown), abs=1e-6)
    assert np.degrees(log.gimbal.angles[0]) == pytest.approx((0.0, -90.0, 0.0))
    assert log.gimbal.yaw_from == "nose"
    with av.open(str(video)) as container:
        assert sum(1 for _ in container.decode(video=0)) == FRAMES


@pytest.mark.parametrize("hevc", [False, True])
@pytest.mark.parametrize("length_size", [0, 2, 4])
def test_messages_in_every_packing(hevc, length_size):
    payload = TELEMETRY_UUID + b"\0\0\0\1" + b"x" * 700
    unit = sei_unit(payload)
    unit = b"\x4e\x01" + unit[1:] if hevc else unit
    front = len(unit).to_bytes(length_size, "big") if length_size else b"\0\0\0\1"
    found = list(unregistered_messages(front + unit, length_size, hevc=hevc))
    assert found == [payload]


@pytest.mark.parametrize(
    "data", [b"{}", b"hello", b"[" * 9000, b'{"schema":"apcg.telemetry.v1","position":[1]}', b"\xff"]
)
def test_messages_that_are_none(data):
    with pytest.raises(ImportFileError, match=r"cam\.mp4"):
        log_of_messages("cam.mp4", [TimedBytes(0, TELEMETRY_UUID + data)])


def test_messages_with_hostile_numbers_and_old_ones(flown):
    spots, bodies = flown.spots(), bodies_deg(flown)
    records = [telemetry(flown, k, spots[k][1], bodies[k]) for k in range(6)]
    records[1]["position"]["lat_e7"] = 10**400
    records[2]["position"]["lat_e7"] = "hello"
    records[3]["position"]["age_ms"] = 5000
    records[4]["vehicle_attitude"]["yaw_rad"] = 1e300
    records[5]["hfov_deg"] = -5
    messages = [TimedBytes(k, TELEMETRY_UUID + json.dumps(record).encode()) for k, record in enumerate(records)]
    log = log_of_messages("cam.mp4", messages)
    assert log.places.t_us.tolist() == [0, 4, 5]
    assert len(log.attitudes) == 5
    assert len(log.view) == 5
    assert log.notes.skipped == {"messages without a position": 3}


@pytest.mark.slow_but_first
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_subtitles_of_a_dji_drone_in_the_video(suffix, flown, tmp_path):
    log, _ = read_film_log(with_subtitles(flown, tmp_path / f"cam{suffix}", "keyed"), coarse=False)
    assert_follows(log, flown, within_deg=5e-6, alt_m=0.01)


def test_subtitles_of_a_siyi_camera(flown, tmp_path):
    video = with_subtitles(flown, tmp_path / "cam.mp4", "siyi")
    log, _ = read_film_log(video, coarse=True)
    spots = flown.spots()
    assert log.places.lat_deg == pytest.approx([spot.lat for _, spot in spots], abs=3e-5)
    assert log.places.std_m == 3.0
    assert np.isnan(log.places.height_m).all()
    assert abs(log.zero_us - flown.frames_us[0]) < 600_000
    assert log.gimbal.yaw_from == "nose"
    assert len(log.attitudes) == 0
    assert read_film_log(video, coarse=False) == (None, ())


@pytest.mark.parametrize(
    ("old", "new"), [("′", "'"), ("°", "° "), ("″", '"'), ("latitude:", "latitude : "), ("gb_yaw:0.0", "gb_yaw:inf")]
)
def test_siyi_in_other_spellings(old, new):
    text = siyi(0, Spot(-35.277389, 148.943417, 651.65, 0.0, unix_us=1_787_000_000_000_000))
    log = siyi_log("cam.mp4", [SubtitleCue(0, text.replace(old, new))])
    assert (log.places.lat_deg[0], log.places.lon_deg[0]) == pytest.approx((-35.277389, 148.943417), abs=2e-5)


def test_siyi_without_a_place():
    text = siyi(0, Spot(-35.277389, 148.943417, 651.65, 0.0)).replace("°16", "°66")
    with pytest.raises(ImportFileError, match=r"cam\.mp4"):
        siyi_log("cam.mp4", [SubtitleCue(0, text)])


def test_a_film_that_carries_nothing(flown):
    assert read_film_log(flown.video, coarse=True) == (None, ())


def test_a_film_that_is_cut_tells_what_is_there(flown, tmp_path):
    video = with_klv(flown, tmp_path / "cam.ts")
    data = video.read_bytes()
    video.write_bytes(data[: len(data) // 2])
    log, _ = read_film_log(video, coarse=True)
    assert 5 <= len(log.places) < FRAMES


def test_klv_sets_begin_with_their_key(flown, tmp_path):
    streams = read_streams(with_klv(flown, tmp_path / "cam.ts"))
    assert len(streams.klv) == FRAMES
    assert all(packet.data.startswith(SETS_KEY) for packet in streams.klv)


def packets(flown, **more):
    """KLV beside the pictures, without the file."""
    return [
        TimedBytes(round(t * 1e6), klv_set(spot, (0.0, 0.0, 30.0), **more.get("set", {}))) for t, spot in flown.spots()
    ]


def test_a_date_that_steps_gives_way_to_the_films_own_times(flown):
    spots = [
        (t, dataclasses.replace(spot, unix_us=spot.unix_us + 18_000_000 * (k >= 24)))
        for k, (t, spot) in enumerate(flown.spots())
    ]
    stepped = log_of_klv("a.ts", [TimedBytes(round(t * 1e6), klv_set(spot, (0.0, 0.0, 30.0))) for t, spot in spots])
    whole = log_of_klv("a.ts", packets(flown))
    assert stepped.places.t_us == pytest.approx(whole.places.t_us, abs=5000)
    assert abs(stepped.zero_us - whole.zero_us) < 5000
    (said,) = stepped.notes.assumed
    assert said.startswith(f"the date in its KLV steps by +18.00 s at {spots[24][0]:.1f} s")
    assert whole.notes.assumed == ()


def test_a_height_above_the_ellipsoid_is_named_and_not_taken_for_one_above_the_sea(flown):
    with pytest.raises(ImportFileError, match=r"above the ellipsoid alone \(tag 75 or 104\)"):
        log_of_klv("a.ts", packets(flown, set={"height_tag": 75}))


def test_sets_behind_others_are_found(flown, tmp_path):
    security = bytes.fromhex("060e2b3402030101") + bytes(8) + b"\x03abc"
    behind = log_of_klv("a.ts", [TimedBytes(each.t_us, security + each.data) for each in packets(flown)])
    assert behind.places.t_us == pytest.approx(log_of_klv("a.ts", packets(flown)).places.t_us)
    assert [kind for kind, _ in _parts(SimpleNamespace(type="data", codec_context=None), security + SETS_KEY)] == [
        "klv"
    ]


def test_data_without_time_stamps_has_that_of_the_pictures_beside_it():
    class Packet(SimpleNamespace):
        dts, size, time_base, is_discard = None, 1, Fraction(1, 10), False

        def __bytes__(self):
            return b"x"

    told = [Packet(stream=name, pts=pts) for name, pts in (("klv", None), ("film", 5), ("klv", None), ("film", 6))]
    container = SimpleNamespace(demux=lambda *_: told)
    assert [(stream, t_s) for stream, t_s, _ in _packets(container, ["film", "klv"])] == [
        ("film", 0.5),
        ("klv", 0.5),
        ("film", 0.6),
    ]


@pytest.mark.parametrize("name", [b"\xff.mp4", b"long" * 50 + b".mp4"])
def test_a_film_that_is_none_is_told_with_why_whatever_its_name(tmp_path, name):
    path = tmp_path / os.fsdecode(name)
    path.write_bytes(b"no film")
    with pytest.raises(VideoError, match=f"^video {re.escape(str(path))}: not a video that can be read"):
        read_streams(path)
