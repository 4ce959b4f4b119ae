"""MPEG-TS with KLV, as FFmpeg, klvdata and our own reader of others' films see it."""

import io
import shutil
from dataclasses import replace

import av
import klvdata
import numpy as np
import pytest

from gcs.camera_aim import CameraAim
from gcs.errors import GcsError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.export.motion_imagery.klv import sight_of
from gcs.importing.film_log import read_film_log
from gcs.playback.analysis import Analysis
from gcs.session.frame_tables import read_times
from gcs.session.session import open_session
from mavlink.geodesy import LocalFrame, rotation_from_euler
from tests.support.command_line import run_gcs
from tests.support.snapshots import snapshot
from vision.camera.camera import R_ENU_NED, R_GIMBAL_CAM

N = 40


@pytest.fixture(scope="module")
def exported(flight, shots, export_to, tmp_path_factory):
    """A recording, and what the export made of it."""
    return flight, export_to(tmp_path_factory.mktemp("klv") / "a.ts"), shots


def packets(path, kind):
    with av.open(str(path)) as container:
        stream = getattr(container.streams, kind)[0]
        return [(round(p.pts * p.time_base * 1e6), bytes(p)) for p in container.demux(stream) if p.size]


def sets_of(data):
    return [each.MetadataList() for each in klvdata.StreamParser(io.BytesIO(data))]


def place_of(shot, p_enu):
    return tuple(float(angle) for angle in shot.origin.to_geodetic(p_enu))


def test_every_frame_has_its_set_and_the_film_is_what_it_was(exported):
    flight, path, shots = exported
    times_us = np.array([shot.t_us for shot in shots])
    with av.open(str(path)) as container:
        assert [stream.type for stream in container.streams] == ["video", "data"]
        assert container.streams[0].codec_context.name == "h264"
        pictures = [(frame.time, frame.to_ndarray(format="gray")) for frame in container.decode(video=0)]
    with av.open(str(flight / "video.mp4")) as container:
        wanted = [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]
    assert all(np.array_equal(shown, as_taken) for (_, shown), as_taken in zip(pictures, wanted, strict=True))
    film_us = np.array([time for time, _ in pictures]) * 1e6
    klv_us = np.array([us for us, _ in packets(path, "data")])
    assert np.abs(film_us - klv_us).max() < 12  # a tick of 90 kHz
    assert np.abs(np.diff(film_us) - np.diff(times_us)).max() < 24


def test_others_read_what_the_uav_reported_and_the_camera_saw(exported):
    _, path, shots = exported
    sets = sets_of(b"".join(data for _, data in packets(path, "data")))
    assert len(sets) == N
    for shot, fields in zip(shots, sets, strict=True):
        lat, lon, alt = place_of(shot, shot.uav_enu)
        told = {tag: float(field[3]) for tag, field in fields.items() if tag not in (1, 2, 3, 10)}
        assert np.datetime64(fields[2][3].split("+")[0], "us").astype(int) == shot.t_us
        assert (told[13], told[14]) == pytest.approx((lat, lon), abs=1e-7)
        assert told[15] == pytest.approx(alt, abs=0.2)
        assert told[16] == pytest.approx(np.degrees(shot.camera.hfov), abs=0.01)
        for k, corner in enumerate(shot.footprint_enu):
            lat, lon, _ = place_of(shot, np.append(corner, shot.camera.ground_z))
            assert (told[82 + 2 * k], told[83 + 2 * k]) == pytest.approx((lat, lon), abs=1e-7)
        # the picture's centre lies where the optical axis meets the ground
        axis = shot.camera.R_enu_cam[:, 2]
        foot = shot.uav_enu + axis * (shot.camera.ground_z - shot.uav_enu[2]) / axis[2]
        lat, lon, up = place_of(shot, foot)
        assert (told[23], told[24]) == pytest.approx((lat, lon), abs=2e-7)
        assert told[25] == pytest.approx(up, abs=0.2)
        assert told[21] == pytest.approx(np.linalg.norm(foot - shot.uav_enu), abs=0.05)
        assert told[65] == 17.0


def test_checksums_are_the_sums_of_sixteen_bit_words(exported):
    for _, data in packets(exported[1], "data"):
        padded = data[:-2] + b"\0" * (len(data) % 2)
        assert int(np.frombuffer(padded, ">u2").sum(dtype=np.uint64)) & 0xFFFF == int.from_bytes(data[-2:], "big")


def test_an_import_of_it_knows_where_the_uav_was_and_looked(exported):
    _, path, shots = exported
    log, troubles = read_film_log(path, coarse=True)
    assert troubles == () and len(log.places) == N
    assert abs(log.zero_us - shots[0].t_us) < 50
    assert np.abs(log.places.t_us + log.zero_us - [shot.t_us for shot in shots]).max() < 50
    assert log.places.heading == pytest.approx([shot.uav_heading for shot in shots], abs=1e-3)
    for shot, angles in zip(shots, log.gimbal.angles, strict=True):
        assert R_ENU_NED @ rotation_from_euler(*angles) @ R_GIMBAL_CAM == pytest.approx(shot.camera.R_enu_cam, abs=1e-3)
    assert log.view.hfov == pytest.approx([shot.camera.hfov for shot in shots], abs=1e-3)


def test_what_is_unknown_is_left_out(tmp_path):
    frame = LocalFrame(48.0, 11.0, 500.0)
    view = CameraAim(R_enu_cam=np.eye(3), R_enu_body=np.full((3, 3), np.nan), hfov=1.0, vfov=0.5, ground_z=0.0)
    shots = [
        snapshot(0),
        replace(snapshot(1), origin=frame, uav_heading=np.nan),
        replace(snapshot(2), origin=frame, camera=view, pose="known"),
    ]
    times_us = np.array([shot.t_us for shot in shots])
    path, notes = tmp_path / "a.ts", []
    sink = FORMATS["klv"].open(ExportJob(path=path, name="Пик " * 40, times_us=times_us, note=notes.append))
    for shot in shots:
        sink.write(shot)
    sink.close()
    tags = [set(fields) for fields in sets_of(b"".join(data for _, data in packets(path, "data")))]
    texts = {1, 2, 3, 10, 65}
    assert tags == [texts, texts | {13, 14, 15}, texts | {5, 13, 14, 15, 16, 17}]
    assert not notes
    sink = FORMATS["klv"].open(ExportJob(path=tmp_path / "b.ts", times_us=times_us, note=notes.append))
    sink.write(shots[0])
    sink.close()
    assert len(notes) == 1 and "time alone" in notes[0]


def test_a_film_that_a_transport_stream_cannot_hold_is_refused(tmp_path):
    with av.open(str(tmp_path / "video.mkv"), "w") as container:
        stream = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="bgr24")))
        container.mux(stream.encode(None))
    path = tmp_path / "a.ts"
    with pytest.raises(GcsError, match="carries no mjpeg"):
        format_for(path).open(ExportJob(path=path, video=tmp_path / "video.mkv"))
    assert not path.exists()


@pytest.mark.slow
def test_a_session_is_made_of_it_again(exported, tmp_path):
    flight, path, shots = exported
    fleet = ("--tlog", flight / "telemetry.tlog", "--clock", "0")
    code, _, err = run_gcs("import", "-o", tmp_path / "again", "--video", path, *fleet)
    assert code == 0, err
    times_us = read_times(tmp_path / "again" / "frames.csv").times_us
    assert np.abs(times_us - [shot.t_us for shot in shots]).max() < 1000
    shutil.copy(flight / "detections.csv", tmp_path / "again" / "detections.csv")
    analysis = Analysis(open_session(tmp_path / "again"))
    found = list(analysis.snapshots(images=False))
    analysis.close()
    for shot, again in zip(shots[10:], found[10:], strict=True):
        places = [each.origin.to_geodetic(each.uav_enu) for each in (shot, again)]
        metres = shot.origin.to_enu(*places[1]) - shot.origin.to_enu(*places[0])
        assert np.linalg.norm(metres[:2]) < 0.5
        centres = [sight_of(each) for each in (shot, again)]
        assert [centres[1][tag] for tag in (23, 24)] == pytest.approx([centres[0][tag] for tag in (23, 24)], abs=1e-5)
        who = [{box.track_id: each.name_of(box.system_id) for box in each.new_boxes} for each in (shot, again)]
        assert sorted(who[0].values()) == sorted(who[1].values())
