from datetime import UTC, datetime

import numpy as np
import pytest

from gcs.errors import SessionError
from gcs.session.frame_tables import read_detections, read_times
from gcs.session.session import create_folder, open_session
from gcs.session.tables import read_table
from infra.session_format import TableFormat


def test_a_name_is_never_reused(tmp_path):
    now = datetime(2026, 11, 20, 10, 33, 12, tzinfo=UTC)
    names = [create_folder(tmp_path, now).name for _ in range(3)]
    assert names == ["2026-11-20_10-33-12Z", "2026-11-20_10-33-12Z.1", "2026-11-20_10-33-12Z.2"]


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match="cannot be made"):
        create_folder(tmp_path / "file")


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(SessionError, match="no such session"):
        open_session(tmp_path / "absent")
    with pytest.raises(SessionError, match=r"no telemetry\.tlog"):
        open_session(tmp_path)
    (tmp_path / "telemetry.tlog").write_bytes(b"x")
    with pytest.raises(SessionError, match=r"absent\.mp4: no such file"):
        open_session(tmp_path, video=tmp_path / "absent.mp4")


def test_finds_the_parts(tmp_path):
    for name in ("telemetry.tlog", "video.mkv", "frames.csv", "truth.csv"):
        (tmp_path / name).write_bytes(b"x")
    session = open_session(tmp_path)
    assert session.mission is None
    assert (session.video, session.frames, session.truth) == (
        tmp_path / "video.mkv",
        tmp_path / "frames.csv",
        tmp_path / "truth.csv",
    )
    assert session.detections is None


TWO_VIEWS = """
uav = { system_id = 1 }
ugv = [{ system_id = 11 }]
clock = { video_offset_s = 0.5 }
[[view]]
system_id = 2
clock = { video_offset_s = "auto" }
"""


def test_each_camera_of_a_flight_is_a_session_of_the_same_telemetry(tmp_path):
    (tmp_path / "view-2").mkdir()
    for name in ("telemetry.tlog", "frames.csv", "view-2/frames.csv", "view-2/detections.csv"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "session.toml").write_text(TWO_VIEWS)
    first = open_session(tmp_path)
    (second,) = first.other_views
    assert second == open_session(tmp_path / "view-2")
    assert (second.other_views, first.is_first_view, second.is_first_view) == ((first,), True, False)
    assert (second.tlog, second.frames) == (first.tlog, tmp_path / "view-2" / "frames.csv")
    assert (first.detections, second.detections) == (None, tmp_path / "view-2" / "detections.csv")
    for session, uav, other, offset in ((first, 1, 2, 0.5), (second, 2, 1, "auto")):
        assert (session.mission.uav.system_id, session.mission.clock.video_offset_s) == (uav, offset)
        assert [view.system_id for view in session.mission.view] == [other]
        assert [session.mission.name_of(i) for i in (1, 2)] == ["UAV", "UAV-2"]
    (tmp_path / "frames.csv").unlink()
    assert second.other_views == ()


def test_a_folder_of_a_camera_that_the_mission_lacks(tmp_path):
    (tmp_path / "view-3").mkdir()
    (tmp_path / "telemetry.tlog").write_bytes(b"x")
    (tmp_path / "session.toml").write_text(TWO_VIEWS)
    with pytest.raises(SessionError, match=r"has 1 \[\[view\]\]; this needs 2"):
        open_session(tmp_path / "view-3")


def test_a_damaged_time_gets_the_one_between(tmp_path):
    path = tmp_path / "frames.csv"
    path.write_text("frame,time_us\n0,1795171703985018\n1,179x\n2,1795171704185018\n")
    found = read_times(path)
    assert found.times_us.tolist() == [1795171703985018, 1795171704085018, 1795171704185018]
    assert (found.skipped, found.unordered) == (1, 0)


def test_bad_rows_are_counted_and_the_rest_is_used(tmp_path):
    path = tmp_path / "detections.csv"
    path.write_text(
        "frame,cx,cy,w,h,angle,score,heading\n"
        "1,10,20,30,15,0.5,0.9,\n"
        "0,11,21,30,15,0.5,0.8,1.25\n"
        "1,oops,20,30,15,0.5,0.9,\n"
        "1,12\n"
        "1,nan,20,30,15,0.5,0.9,\n"
        "1,13,20,30,15,0.5,0.7,2\n"
    )
    boxes = read_detections(path)
    assert boxes.skipped == 3
    assert boxes.at(1).cx.tolist() == [10, 13]
    assert np.isnan(boxes.at(1).heading[0])
    assert boxes.at(0).heading.tolist() == [1.25]
    assert len(boxes.at(7)) == 0


def test_a_missing_column_is_named(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("frame,cx\n1,2\n")
    with pytest.raises(SessionError, match="column 'cy' is missing"):
        read_table(path, TableFormat("t.csv", "frame,cx,cy"))
    with pytest.raises(SessionError, match="no such file"):
        read_table(tmp_path / "absent.csv", TableFormat("absent.csv", "frame"))
