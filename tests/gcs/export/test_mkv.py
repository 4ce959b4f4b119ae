"""The copy of a film with names, as FFmpeg's demuxer and pysubs2 read it."""

from dataclasses import replace

import av
import numpy as np
import pysubs2
import pytest

from gcs.errors import GcsError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.session.frame_tables import read_times
from tests.support.command_line import run_gcs
from tests.support.snapshots import box, snapshot
from vision.errors import VideoError

START_US = 1_795_171_704_000_000
N = 24


def film(path, size=(320, 240), bframes=2, codec="libx264"):
    """A film with B-frames whose own time stamps are even."""
    with av.open(str(path), "w") as container:
        options = {"x264-params": f"bframes={bframes}:b-adapt=0:keyint=10"} if codec == "libx264" else {}
        stream = container.add_stream(codec, rate=10, options=options)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for k in range(N):
            grey = np.full((size[1], size[0], 3), 40 + 5 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
        container.mux(stream.encode(None))
    return path


def uneven_us():
    """Frames that came as frames of a bad link do."""
    return START_US + np.cumsum(np.random.default_rng(3).integers(20_000, 300_000, N)).astype(np.int64)


def copied(video, path, times_us, snapshots):
    sink = format_for(path).open(ExportJob(path=path, name="a <flight>", video=video, times_us=times_us))
    for shot in snapshots:
        sink.write(shot)
    sink.close()
    return path


def named(frame, k=2):
    return replace(snapshot(frame, boxes=[box(1, k, cx=150.0, cy=120.0)]), width=320, height=240)


def packets(path, kind):
    with av.open(str(path)) as container:
        stream = getattr(container.streams, kind)[0]
        return [(float(p.pts * p.time_base), bytes(p)) for p in container.demux(stream) if p.size]


def test_the_film_is_copied_byte_by_byte_and_shown_when_its_frames_were_taken(tmp_path):
    video, times_us = film(tmp_path / "video.mp4"), uneven_us()
    path = copied(video, tmp_path / "a.mkv", times_us, [named(frame) for frame in range(N)])
    with av.open(str(path)) as container:
        assert [stream.codec_context.codec.canonical_name for stream in container.streams] == ["h264", "ass"]
        assert container.metadata["title"] == "a <flight>"
        grey = [(frame.time, int(frame.to_ndarray(format="gray").mean())) for frame in container.decode(video=0)]
    assert [data for _, data in packets(path, "video")] == [data for _, data in packets(video, "video")]
    times_s = np.array([time for time, _ in grey])
    assert np.abs(times_s - times_s[0] - (times_us - times_us[0]) * 1e-6).max() <= 0.001
    assert [level for _, level in grey] == sorted({level for _, level in grey})  # in the order in which they were taken


def test_each_name_is_shown_from_its_frame_to_the_next(tmp_path):
    video, times_us = film(tmp_path / "video.mp4"), uneven_us()
    path = copied(video, tmp_path / "a.mkv", times_us, [named(frame, 2 + frame % 2) for frame in range(N)])
    with av.open(str(path)) as container:
        shown_ms = [round(frame.time * 1000) for frame in container.decode(video=0)]
    with av.open(str(path)) as container:
        header = container.streams.subtitles[0].codec_context.extradata.decode()
        lines = [
            (round(p.pts * p.time_base * 1000), round(p.duration * p.time_base * 1000), bytes(p).decode())
            for p in container.demux(subtitles=0)
            if p.size
        ]
    assert [start for start, _, _ in lines] == shown_ms
    assert [start + duration for start, duration, _ in lines[:-1]] == shown_ms[1:]
    assert [text.endswith(("Alpha? 98%", "UGV-3? 98%")[k % 2]) for k, (_, _, text) in enumerate(lines)] == [True] * N
    whole = header + "".join(
        f"Dialogue: 0,0:00:00.00,0:00:01.00,{text.split(',', 2)[2]}\n" for _, _, text in lines
    )  # the layer is the field before the style
    read = pysubs2.SSAFile.from_string(whole)
    assert (read.info["PlayResX"], read.info["PlayResY"]) == ("320", "240")
    assert [line.plaintext for line in read[:2]] == ["Alpha? 98%", "UGV-3? 98%"]


@pytest.mark.slow
def test_a_recording_that_went_on_in_another_file_is_one_film(tmp_path):
    video = film(tmp_path / "video.mkv")
    with av.open(str(film(tmp_path / "more.mp4"))) as more, av.open(str(tmp_path / "video.1.mkv"), "w") as rest:
        rest.metadata["FIRST_FRAME"], rest.metadata["START_US"] = str(N), str(START_US + 2_000_000)
        stream = rest.add_stream_from_template(more.streams.video[0])
        for packet in more.demux(video=0):
            if packet.size:
                packet.stream = stream
                rest.mux(packet)
    times_us = START_US + 50_000 * np.arange(2 * N)
    path = copied(video, tmp_path / "a.mkv", times_us, [named(frame) for frame in range(2 * N)])
    with av.open(str(path)) as container:
        times_s = [frame.time for frame in container.decode(video=0)]
    assert np.allclose(np.diff(times_s), 0.05) and len(times_s) == 2 * N
    (tmp_path / "video.1.mkv").unlink()
    small = film(tmp_path / "small.mkv", size=(160, 120))
    with av.open(str(small)) as more, av.open(str(tmp_path / "video.1.mkv"), "w") as rest:
        rest.metadata["FIRST_FRAME"], rest.metadata["START_US"] = str(N), "0"
        stream = rest.add_stream_from_template(more.streams.video[0])
        for packet in more.demux(video=0):
            if packet.size:
                packet.stream = stream
                rest.mux(packet)
    with pytest.raises(VideoError, match="coded otherwise"):
        copied(video, tmp_path / "b.mkv", times_us, [])
    assert not (tmp_path / "b.mkv").exists()


def test_clocks_that_stand_or_go_back_make_no_file_that_cannot_be_played(tmp_path):
    times_us = uneven_us()
    times_us[8:12] = times_us[8]
    times_us[15] -= 400_000
    path = copied(film(tmp_path / "video.mp4"), tmp_path / "a.mkv", times_us, [named(frame) for frame in range(N)])
    with av.open(str(path)) as container:
        times_s = [frame.time for frame in container.decode(video=0)]
    assert len(times_s) == N and (np.diff(times_s) > 0).all()


@pytest.mark.slow
def test_a_session_becomes_a_film_with_names(flight, tmp_path):
    code, _, err = run_gcs("export", flight, "-o", tmp_path / "a.mkv")
    assert code == 0, err
    times_us = read_times(flight / "frames.csv").times_us
    starts = sorted({start for start, _ in packets(tmp_path / "a.mkv", "subtitles")})
    assert np.allclose(starts, (times_us - times_us[0]) * 1e-6, atol=1e-3)
    code, _, err = run_gcs("export", flight, "-o", tmp_path / "a.mkv")
    assert code and "exists already" in err
    with pytest.raises(GcsError, match="no video in it"):
        FORMATS["mkv"].open(ExportJob(path=tmp_path / "b.mkv", name="bare"))


def test_what_matroska_cannot_hold_is_one_line_and_leaves_no_file(tmp_path):
    video = film(tmp_path / "video.avi", bframes=0, codec="msmpeg4v2")
    with pytest.raises(GcsError, match=r"video\.avi: cannot be written as Matroska"):
        copied(video, tmp_path / "a.mkv", uneven_us(), [named(frame) for frame in range(N)])
    assert [path.name for path in tmp_path.iterdir()] == ["video.avi"]
