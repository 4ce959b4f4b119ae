"""Sessions of others: one bad row costs that row, is counted and told, and asks for no memory beyond the file's."""

import tracemalloc
from pathlib import Path

import av
import numpy as np
import pytest

from gcs.cli.results.score import print_score
from gcs.errors import ConfigError, SessionError
from gcs.mission.mission import load_mission
from gcs.playback.analysis import Analysis
from gcs.playback.moments import QUIET_US
from gcs.report.score import score_files
from gcs.session.clock_steps import MAX_STEPS, ClockSteps
from gcs.session.frame_tables import MAX_MISSING, read_detections, read_times
from gcs.session.identity_log import read_identity
from gcs.session.identity_replay import read_snapshots
from gcs.session.session import open_session
from gcs.session.tables import MAX_BOXES, read_table
from infra.session_format import TableFormat
from tests.support.bundled import swarm_session
from tests.support.command_line import run_gcs
from tests.support.frames import packet
from tests.support.snapshots import ONE_UGV
from vision.errors import VideoError
from vision.video.video import VideoFile

T0 = 1_795_171_704_000_000
ROWS = {
    "frames.csv": [
        "20000000000,{t}",
        "1000000000,{t}",
        "-5,{t}",
        "7.5,{t}",
        "inf,{t}",
        "nan,{t}",
        "1e400,{t}",
        "3,-1",
        "3," + "9" * 400,
        "x" * 100_000,
        '"3,{t}',
        "\0,\0",
    ],
    "detections.csv": [
        "3,inf,2,3,4,0,0.5,",
        "3,1,2,-3,4,0,0.5,",
        "3,1,2,nan,4,0,0.5,",
        "3,1,2,3,4,1e300,0.5,",
        "3,1,2,3,4,0,1e9,",
        "3,1,2,3,4,0,0.5,inf",
        "2e18,1,2,3,4,0,0.5,",
        "-1,1,2,3,4,0,0.5,",
        '"',
        "3",
    ],
    "truth.csv": ["3,inf,2,3,4,0,2", "3,1,2,3,4,0,1e300", "1e300,1,2,3,4,0,2", "3,1,2,3,4,0,-2", "3,1,2,3,4,0,2.5"],
}


def appended(folder, name, rows):
    with (folder / name).open("a") as file:
        file.write("\n" + "\n".join(row.format(t=T0) for row in rows) + "\n")


def peak_bytes(work):
    """Most memory that something took at once, and what it gave."""
    tracemalloc.start()
    try:
        result = work()
        return tracemalloc.get_traced_memory()[1], result
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_bad_rows_cost_themselves_and_the_names_stay(tmp_path, capsys):
    folder = swarm_session(tmp_path)
    assert run_gcs("identify", folder, "-o", tmp_path / "before")[0] == 0
    for name, rows in ROWS.items():
        appended(folder, name, rows)
    (folder / "clock.csv").write_text("record,t_us,offset_us,step_us\n-5,1,1,1e300\n1e300,0,0,5\n")
    (folder / "refused.csv").write_text("record,t_us,link,peer,auth\n-1,0,0,0,3\n1e30,0,0,0,3\n0,1e30,0,0,1e9\n")
    code, _, stderr = run_gcs("identify", folder, "-o", tmp_path / "after")
    assert code == 0, stderr
    assert "Traceback" not in stderr and "Warning" not in stderr
    assert f"frames.csv: {len(ROWS['frames.csv'])} rows cannot be used" in stderr
    assert f"detections.csv: {len(ROWS['detections.csv'])} rows could not be read" in stderr
    assert (tmp_path / "after" / "identity.csv").read_bytes() == (tmp_path / "before" / "identity.csv").read_bytes()
    for name, count in {"clock.csv": 2, "refused.csv": 3}.items():
        assert f"{name}: {count} rows cannot be read and are left out" in stderr
    scored = score_files(folder / "truth.csv", tmp_path / "after" / "identity.csv")
    assert scored.skipped == len(ROWS["truth.csv"])
    print_score(scored)
    assert f"{scored.skipped} rows could not be used" in capsys.readouterr().out


@pytest.mark.parametrize("frame", [20_000_000_000, 1_000_000_000, 3_000_000, -1])
def test_a_frame_index_asks_for_no_memory(tmp_path, frame):
    path = tmp_path / "frames.csv"
    path.write_text("frame,time_us\n" + "".join(f"{k},{T0 + 40_000 * k}\n" for k in range(50)) + f"{frame},{T0}\n")
    peak, times = peak_bytes(lambda: read_times(path))
    assert times.times_us.tolist() == [T0 + 40_000 * k for k in range(50)]
    assert times.skipped == 1
    assert peak < 4 << 20
    path.write_text(f"frame,time_us\n{MAX_MISSING * 2},{T0}\n")
    with pytest.raises(SessionError, match="no frame in it that could be"):
        read_times(path)


def test_frames_that_were_lost_or_looked_at_now_and_then_keep_their_places(tmp_path):
    path = tmp_path / "frames.csv"
    frames = [*range(100), *range(90_000, 90_100), 120_000]
    path.write_text("frame,time_us\n" + "".join(f"{k},{T0 + 40_000 * k}\n" for k in frames))
    times = read_times(path)
    assert times.skipped == 1, "what is too far off to be a gap"
    assert (times.times_us == T0 + 40_000 * np.arange(90_100)).all()


@pytest.mark.parametrize(
    "wrong_us", [-T0, 40 * 366 * 86_400_000_000, 3_600_000_000, -3_600_000_000, 20_000_000, -500_000]
)
def test_a_time_that_is_not_between_its_neighbours_costs_its_row(tmp_path, wrong_us):
    path = tmp_path / "frames.csv"
    rows = [T0 + 40_000 * k for k in range(50)]
    rows[20] += wrong_us
    path.write_text("frame,time_us\n" + "".join(f"{k},{t}\n" for k, t in enumerate(rows)))
    times = read_times(path)
    assert times.skipped == 1
    assert times.times_us.tolist() == [T0 + 40_000 * k for k in range(50)]


def test_a_clock_that_was_set_costs_no_row(tmp_path):
    path = tmp_path / "frames.csv"
    for step_us in (5_000_000, -5_000_000, -7_200_000_000, 86_400_000_000):
        rows = [T0 + 40_000 * k + step_us * (k >= 60) for k in range(120)]
        path.write_text("frame,time_us\n" + "".join(f"{k},{t}\n" for k, t in enumerate(rows)))
        times = read_times(path)
        assert times.times_us.tolist() == rows
        assert (times.skipped, times.unordered) == (0, 0)


def test_shuffled_frames_are_sorted_and_told(tmp_path):
    folder = swarm_session(tmp_path)
    header, *rows = (folder / "frames.csv").read_text().split()
    order = np.random.default_rng(1).permutation(len(rows))
    (folder / "frames.csv").write_text("\n".join([header, *(rows[k] for k in order)]))
    analysis = Analysis(open_session(folder))
    assert any("rows are out of order; they were sorted by frame" in text for text in analysis.warnings)
    assert (np.diff(analysis.times_us) > 0).all()
    frames, times = zip(*(row.split(",") for row in rows), strict=True)
    mixed = [f"{frame},{times[k]}" for frame, k in zip(frames, order, strict=True)]
    (folder / "frames.csv").write_text("\n".join([header, *mixed]))
    analysis = Analysis(open_session(folder))
    assert any("frames.csv: " in text for text in analysis.warnings)


def test_boxes_without_end_in_one_frame_are_cut_off(tmp_path):
    path = tmp_path / "detections.csv"
    row = ",1,2,3,4,0,0.5,\n"
    path.write_text("frame,cx,cy,w,h,angle,score,heading\n" + f"3{row}" * (MAX_BOXES + 50) + f"4{row}" * 10 + f"3{row}")
    boxes = read_detections(path)
    assert (len(boxes.at(3)), len(boxes.at(4)), boxes.skipped) == (MAX_BOXES, 10, 51)


def test_memory_is_some_times_the_file(tmp_path):
    path = tmp_path / "frames.csv"
    path.write_text("frame,time_us\n" + "x" * 3_000_000 + "\n" + ",".join("1" * 1_000_000) + f"\n0,{T0}\n")
    peak, times = peak_bytes(lambda: read_times(path))
    assert (times.skipped, times.times_us.tolist()) == (2, [T0])
    assert peak < 4 << 20


def test_numbers_in_quotation_marks_are_numbers(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('\ufeff"frame", "cx"\r\n"1","2.5"\r\n"2,3\r\n')
    table = read_table(path, TableFormat("t.csv", "frame,cx"))
    assert (table["frame"].tolist(), table["cx"].tolist(), table.skipped) == ([1, 2], [2.5, 3], 0)


def test_a_log_of_two_records_years_apart_asks_for_no_memory(tmp_path):
    hour_us = 23 * 3_600_000_000
    log = tmp_path / "telemetry.tlog"
    times_us = [T0 + hour_us * k for k in range(200)]
    log.write_bytes(b"".join(t_us.to_bytes(8, "big") + packet(k).raw for k, t_us in enumerate(times_us)))
    (tmp_path / "session.toml").write_text("[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n")
    peak, analysis = peak_bytes(lambda: Analysis(open_session(tmp_path)))
    assert len(analysis.times_us) <= 200 * (QUIET_US // 200_000 + 1)
    assert analysis.times_us[-1] >= times_us[-1] - 200_000
    assert peak < 8 << 20


def test_an_identity_log_of_others_is_shown_as_far_as_it_goes(tmp_path):
    path = tmp_path / "identity.csv"
    header = "time_us,frame,track_id,system_id,confidence,cx,cy,w,h,angle,heading,lat,lon\n"
    good = f"{T0},0,1,2,0.9,10,20,30,15,0.5,1.2,47.5,8.2\n"
    bad = [
        f"{T0},0,inf,2,0.9,10,20,30,15,0.5,,,\n",
        f"{T0},0,1,1e300,0.9,10,20,30,15,0.5,,,\n",
        "1e300,0,1,2,0.9,10,20,30,15,0.5,,,\n",
        f"{T0},0,1,2,0.9,10,-inf,30,15,0.5,,,\n",
        f"{T0},0,1,2,0.9,10,20,30,15,0.5,,900,8\n",
    ]
    path.write_text(header + "".join(bad) + good)
    assert read_identity(path).skipped == len(bad)
    said = []
    (shot,) = read_snapshots(path, ONE_UGV, None, said.append)
    assert said == [f"{path}: {len(bad)} rows could not be used"]
    assert [box.system_id for box in shot.boxes] == [2]


def test_a_clock_set_without_end_is_followed_so_far(tmp_path):
    (tmp_path / "clock.csv").write_text("record,t_us,offset_us,step_us\n" + f"5,{T0},1,2000000\n" * (3 * MAX_STEPS))
    assert len(ClockSteps.read(tmp_path / "clock.csv")) == MAX_STEPS


@pytest.mark.parametrize(
    "line",
    ["x = 1" + "0" * 5000, "fx = 1" + "0" * 400, "width = 99999999999999999999", "distortion = [1e300, 0, 0, 0, 0]"],
)
def test_numbers_without_end_in_a_session_file_are_refused_in_a_line(tmp_path, line):
    (tmp_path / "session.toml").write_text(f"[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 2\n[camera]\n{line}\n")
    with pytest.raises(ConfigError) as error:
        load_mission(tmp_path / "session.toml")
    assert len(str(error.value)) < 500


def film(path, **tags):
    with av.open(str(path), "w", format="matroska") as container:
        container.metadata.update(tags)
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for k in range(5):
            frame = av.VideoFrame.from_ndarray(np.full((32, 32, 3), 40 * k, np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.slow_but_first
@pytest.mark.parametrize("first", ["999999999999", "9" * 5000, "20000000"])
def test_a_video_that_says_it_goes_on_far_away_asks_for_no_memory(tmp_path, first):
    film(tmp_path / "video.mkv")
    film(tmp_path / "video.1.mkv", FIRST_FRAME=first, START_US="9" * 17)
    peak, video = peak_bytes(lambda: VideoFile.open(tmp_path / "video.mkv"))
    assert video.n == 5
    assert peak < 1 << 20
    video.close()
    Path(tmp_path / "video.mkv").unlink()
    film(tmp_path / "video.mkv", FIRST_FRAME=first)
    with VideoFile.open(tmp_path / "video.mkv") as video:
        assert video.n == 5


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    "text",
    [
        "ffconcat version 1.0\nfile real.mkv\n",
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nreal.mkv\n#EXT-X-ENDLIST\n",
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nm=video 5600 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    ],
)
def test_a_video_that_names_other_files_is_none(tmp_path, text):
    film(tmp_path / "real.mkv")
    (tmp_path / "video.mkv").write_text(text)
    with pytest.raises(VideoError, match="not a video that can be read"):
        VideoFile.open(tmp_path / "video.mkv")


@pytest.mark.slow_but_first
@pytest.mark.parametrize("suffix", [".mkv", ".mp4", ".ts", ".mov", ".avi"])
def test_every_container_of_a_session_is_read(tmp_path, suffix):
    path = tmp_path / f"video{suffix}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for _ in range(5):
            frame = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with VideoFile.open(path) as video:
        assert video.n == 5
