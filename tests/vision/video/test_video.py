"""Video files: the number that each frame carries must be the index under which it is found."""

from __future__ import annotations

import errno
import os
import shutil
from types import SimpleNamespace

import av
import numpy as np
import pytest

from infra.files import restorable_file as kept_file
from tests.support.video_senders import HEIGHT, WIDTH, number_of, steady, write_clip
from vision.errors import VideoError
from vision.stream.connection import open_input
from vision.stream.source import parse_source
from vision.video.recording import Recording
from vision.video.video import VideoFile


def varying(n):
    return np.cumsum(np.random.default_rng(3).integers(15, 200, n))


@pytest.fixture(params=["mp4", "mkv", "ts"])
def container(request):
    return request.param


@pytest.mark.slow_but_first
@pytest.mark.parametrize("rhythm", [steady, varying])
def test_every_frame_is_found_under_its_number(tmp_path, container, rhythm):
    pts = rhythm(60)
    with VideoFile.open(write_clip(tmp_path / f"clip.{container}", pts), start_us=1_000_000) as video:
        assert (video.n, video.width, video.height, video.mismatch) == (60, WIDTH, HEIGHT, 0)
        shown = list(video.frames())
        assert [frame.index for frame in shown] == [number_of(frame.image) for frame in shown] == list(range(60))
        np.testing.assert_allclose(video.times_us - 1_000_000, (pts - pts[0]) * 1000, atol=1000)
        assert [frame.t_us for frame in shown] == video.times_us.tolist()
        for index in np.random.default_rng(0).integers(0, 60, 25):
            assert number_of(video.read(int(index)).image) == index


def test_reading_on_and_jumping_mix(tmp_path):
    with VideoFile.open(write_clip(tmp_path / "clip.mp4", steady(60))) as video:
        for index in (0, 1, 2, 5, 59, 58, 59, 12, 11, 13, 0, 59):
            assert number_of(video.read(index).image) == index
        assert [number_of(frame.image) for frame in video.frames(start=50)] == list(range(50, 60))
        assert list(video.frames(start=60)) == []
        assert video.fps == pytest.approx(25.0)


def test_iterators_are_independent_and_can_be_closed_early(tmp_path):
    with VideoFile.open(write_clip(tmp_path / "clip.mkv", steady(30))) as video:
        first, second = video.frames(), video.frames(start=20)
        assert (next(first).index, next(second).index, next(first).index) == (0, 20, 1)
        first.close()
        assert next(second).index == 21
        second.close()


def test_given_times_are_used(tmp_path):
    path = write_clip(tmp_path / "clip.mp4", steady(20))
    times = 1_800_000_000_000_000 + np.arange(20) * 33_333
    with VideoFile.open(path, times) as video:
        assert video.read(7).t_us == times[7]
        assert video.fps == pytest.approx(30.0, rel=1e-3)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("rows", "n", "mismatch"), [(25, 20, 5), (15, 15, -5)])
def test_the_shorter_of_times_and_frames_counts(tmp_path, rows, n, mismatch):
    with VideoFile.open(write_clip(tmp_path / "clip.mp4", steady(20)), np.arange(rows) * 40_000) as video:
        assert (video.n, video.mismatch) == (n, mismatch)
        assert len(list(video.frames())) == n
        with pytest.raises(IndexError, match="no frame"):
            video.read(n)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("kind", ["mkv", "ts"])
def test_a_file_cut_short_plays_what_is_there(tmp_path, kind):
    path = write_clip(tmp_path / f"clip.{kind}", steady(100))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 6 // 10])
    with VideoFile.open(path) as video:
        assert 35 < video.n < 80
        numbers = [number_of(frame.image) for frame in video.frames()]
        assert numbers[:-1] == list(range(len(numbers) - 1))
        assert len(numbers) >= video.n - 3
        assert number_of(video.read(video.n // 2).image) == video.n // 2


def test_a_stream_that_begins_between_key_frames_starts_at_the_first(tmp_path):
    path = write_clip(tmp_path / "clip.ts", steady(60), bframes=0)
    whole = path.read_bytes()
    packets = [whole[i : i + 188] for i in range(0, len(whole), 188)]
    path.write_bytes(b"".join(packets[:3] + packets[12:]))
    with VideoFile.open(path) as video:
        numbers = [number_of(frame.image) for frame in video.frames()]
        assert numbers[0] % 12 == 0 and numbers == list(range(numbers[0], 60))
        assert number_of(video.read(5).image) == numbers[5]


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no such file"), (b"", "empty"), (b"no video at all " * 500, "not a video"), (bytes(5000), "not a video")],
    ids=["missing", "empty", "text", "zeros"],
)
def test_what_is_no_video_is_refused_in_one_line(tmp_path, content, words, capfd):
    path = tmp_path / "clip.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(VideoError, match=words) as caught:
        VideoFile.open(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_folder_is_no_video(tmp_path):
    with pytest.raises(VideoError, match="not a file"):
        VideoFile.open(tmp_path)


@pytest.mark.parametrize("opened", [VideoFile.open, lambda path: open_input(parse_source(str(path)))])
def test_a_coding_that_ffmpeg_does_not_know_is_refused(tmp_path, opened):
    path = write_clip(tmp_path / "clip.mkv", steady(5))
    path.write_bytes(path.read_bytes().replace(b"V_MPEG4/ISO/AVC", b"V_MPEG9/ISO/AVC"))
    with pytest.raises(VideoError, match=r"clip.mkv: FFmpeg does not know how its pictures are coded"):
        opened(path)


def test_an_mp4_without_its_table_is_refused(tmp_path):
    path = write_clip(tmp_path / "clip.mp4", steady(30))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(VideoError, match="not a video"):
        VideoFile.open(path)


def broken_off(folder):
    """20 frames, then a hole of 3, 15 more, and a file that died before its first; numbers are indices."""
    recording, at = Recording(folder / "video.mkv"), 0
    for first, n in ((0, 20), (23, 15)):
        with av.open(str(write_clip(folder / "part.mp4", steady(first + n), bframes=0, gop=1))) as clip:
            stream = clip.streams.video[0]
            packets = [packet for packet in clip.demux(stream) if packet.size]
            recording.begin(stream, first, 1000.0 + first * 0.04)
            for packet in packets[first : first + n]:
                recording.write(packet, 1000.0 + float(packet.pts * packet.time_base))
                at += 1
        recording.close()
    (folder / "video.2.mkv").write_bytes(b"")
    assert recording.error == "" and at == 35
    return folder / "video.mkv"


@pytest.mark.slow
def test_a_recording_in_several_files_is_one_video(tmp_path):
    path = broken_off(tmp_path)
    times = 5_000_000 + np.arange(38) * 40_000
    with VideoFile.open(path, times) as video:
        assert (video.n, video.mismatch, video.missing) == (38, 0, 3)
        recorded = [*range(20), *range(23, 38)]
        assert [(frame.index, number_of(frame.image)) for frame in video.frames()] == [(k, k) for k in recorded]
        assert [frame.index for frame in video.frames(start=21)] == list(range(23, 38))
        assert [frame.t_us for frame in video.frames()] == times[recorded].tolist()
        assert [number_of(video.read(k).image) for k in (37, 2, 24, 19, 23)] == [37, 2, 24, 19, 23]
        with pytest.raises(VideoError, match="not recorded"):
            video.read(21)
    with VideoFile.open(path, start_us=7) as video:
        np.testing.assert_allclose(video.times_us - 7, np.arange(38) * 40_000, atol=1000)
    with VideoFile.open(path, times[:10]) as video:
        assert video.n == len(list(video.frames())) == 10


@pytest.mark.slow
def test_a_part_that_somebody_deleted_costs_itself_only(tmp_path):
    path = broken_off(tmp_path)
    times = 5_000_000 + np.arange(38) * 40_000
    (tmp_path / "video.1.mkv").rename(tmp_path / "video.10.mkv")
    with VideoFile.open(path, times) as video:
        assert [frame.index for frame in video.frames()] == [*range(20), *range(23, 38)]
    path.unlink()
    with VideoFile.open(path, times) as video:
        assert [(frame.index, number_of(frame.image)) for frame in video.frames()] == [(k, k) for k in range(23, 38)]


def test_a_file_of_another_recording_is_not_taken_in(tmp_path):
    path = write_clip(tmp_path / "video.mkv", steady(10))
    write_clip(tmp_path / "video.1.mkv", steady(10))
    with VideoFile.open(path) as video:
        assert video.n == 10


def test_a_cut_recording_keeps_nearly_every_frame(tmp_path):
    """Bytes up to any place, as after a kill: all but the frame that was being written."""
    recording = Recording(tmp_path / "video.mkv")
    sizes = []
    with av.open(str(write_clip(tmp_path / "clip.mp4", steady(250), bframes=0))) as clip:
        stream = clip.streams.video[0]
        recording.begin(stream, 0, 0.0)
        for packet in clip.demux(stream):
            if packet.size:
                recording.write(packet, float(packet.pts * packet.time_base))
                sizes.append(recording.path.stat().st_size)
    # on disk at every moment: all that was written but the last
    data = recording.path.read_bytes()
    for share in (0.3, 0.6, 0.9):
        cut = tmp_path / f"cut{share}.mkv"
        cut.write_bytes(data[: int(share * sizes[-1])])
        whole = sum(size <= share * sizes[-1] for size in sizes)
        with VideoFile.open(cut) as video:
            assert video.n >= whole - 1
            assert [number_of(frame.image) for frame in video.frames()][:whole] == list(range(whole))[: video.n]
    assert sizes[-1] == len(data)
    recording.close()


@pytest.mark.slow_but_first
@pytest.mark.parametrize("how", ["file deleted", "folder deleted", "folder moved"])
def test_a_recording_that_is_deleted_or_moved_is_put_back_and_goes_on(tmp_path, monkeypatch, how):
    monkeypatch.setattr(kept_file, "LOOK_S", 0.0)
    folder = tmp_path / "session"
    folder.mkdir()
    recording, told = Recording(folder / "video.mkv"), []
    with av.open(str(write_clip(tmp_path / "clip.mp4", steady(60), bframes=0))) as clip:
        stream = clip.streams.video[0]
        for index, packet in enumerate(packet for packet in clip.demux(stream) if packet.size):
            now_s = float(packet.pts * packet.time_base)
            if packet.is_keyframe and recording.wants_segment(stream, now_s):
                recording.begin(stream, index, now_s)
            if index == 15:
                if how == "folder moved":
                    folder.rename(tmp_path / "elsewhere")
                elif how == "folder deleted":
                    shutil.rmtree(folder)
                else:
                    recording.path.unlink()
            recording.write(packet, now_s)
            told.append(recording.error)
    recording.close()
    assert any("deleted or moved while it was written" in text for text in told) and recording.error == ""
    with VideoFile.open(folder / "video.mkv") as video:
        assert [number_of(frame.image) for frame in video.frames()] == [*range(16), *range(24, 60)]
        assert video.missing == 8


def test_a_full_disk_leaves_no_row_of_empty_files(tmp_path, monkeypatch):
    recording = Recording(tmp_path / "video.mkv")

    def full(packet):
        recording.path.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with av.open(str(write_clip(tmp_path / "clip.mp4", steady(3), bframes=0))) as clip:
        stream = clip.streams.video[0]
        packet = next(clip.demux(stream))
        for now_s in (0.0, 10.0, 30.0):
            assert recording.wants_segment(stream, now_s)
            recording.begin(stream, 0, now_s)
            monkeypatch.setattr(recording, "_container", SimpleNamespace(mux=full, close=lambda: None))
            recording.write(packet, now_s)
            assert "No space left on device" in recording.error and list(tmp_path.glob("video*")) == []
        recording.begin(stream, 0, 60.0)
        recording.write(packet, 60.0)
        assert recording.error == ""
    recording.close()
    assert [path.name for path in tmp_path.glob("video*")] == ["video.mkv"]


def test_a_disk_that_fails_for_a_while_costs_what_came_meanwhile(tmp_path, monkeypatch):
    recording = Recording(tmp_path / "video.mkv")
    with av.open(str(write_clip(tmp_path / "clip.mp4", steady(60), bframes=0))) as clip:
        stream = clip.streams.video[0]
        for index, packet in enumerate(packet for packet in clip.demux(stream) if packet.size):
            now_s = index * 0.5
            if packet.is_keyframe and recording.wants_segment(stream, now_s):
                recording.begin(stream, index, now_s)
            if index == 15:
                monkeypatch.setattr(recording, "_stream", None)
                recording._fail(OSError("no space left on device"), now_s)
                assert "no space left" in recording.error
            recording.write(packet, now_s)
    recording.close()
    assert recording.error == "" and recording.segment == 1
    with VideoFile.open(tmp_path / "video.mkv") as video:
        assert [number_of(frame.image) for frame in video.frames()] == [*range(15), *range(24, 60)]
        assert video.missing == 9
