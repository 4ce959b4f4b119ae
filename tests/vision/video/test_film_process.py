"""A film that brings FFmpeg down, or has it go on for ever, is one line for who reads it."""

import os
import shutil
import signal
from itertools import count
from types import SimpleNamespace

import psutil
import pytest

from infra.processes.child_process import ChildProcess
from infra.shared_memory import make_memory
from tests.support.video_senders import HEIGHT, WIDTH, number_of, steady, write_clip
from vision.errors import VideoError
from vision.video import film_process, recording_parts
from vision.video.film_process import FilmReader
from vision.video.recording_parts import read_parts
from vision.video.video import VideoFile


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("trouble", "told"), [(signal.SIGKILL, "FFmpeg ended: signal 9"), (signal.SIGSTOP, "FFmpeg takes longer than 1 s")]
)
@pytest.mark.parametrize("reads", [lambda film: film.read(20), lambda film: list(film.frames(20))])
def test_a_process_that_dies_or_hangs_is_one_line(tmp_path, monkeypatch, trouble, told, reads):
    monkeypatch.setattr(film_process, "_NEXT_S", 1.0)
    path = write_clip(tmp_path / "clip.mp4", steady(40))
    film = FilmReader(path)
    assert len(film.index.pts) == 40 and film.read(3) is not None
    os.kill(film._process.pid, trouble)
    with pytest.raises(VideoError, match=f"clip.mp4: {told}"):
        reads(film)
    film.close()
    assert film._process.ended


def test_it_ends_with_who_asked(tmp_path):
    others = psutil.Process().children()
    video = VideoFile.open(write_clip(tmp_path / "clip.mp4", steady(40)))
    frames = video.frames(3)
    assert next(frames).index == 3 and video.read(7).index == 7
    assert len(psutil.Process().children()) == len(others) + 2
    del video, frames
    assert psutil.Process().children() == others


def test_that_no_process_starts_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(film_process, "make_memory", lambda size: (_ for _ in ()).throw(OSError(12, "no memory")))
    with pytest.raises(VideoError, match="no process starts to read it: no memory"):
        FilmReader(write_clip(tmp_path / "clip.mp4", steady(4)))


@pytest.mark.parametrize(("content", "told"), [(None, None), (b"no film", "not a video that can be read")])
def test_a_name_that_is_not_utf_8(tmp_path, content, told):
    path = write_clip(tmp_path / "clip.mp4", steady(4)).rename(tmp_path / os.fsdecode(b"\xff.mp4"))
    if content is None:
        with VideoFile.open(path) as video:
            assert video.read(2).index == 2
        return
    path.write_bytes(content)
    with pytest.raises(VideoError, match=told):
        VideoFile.open(path)


def test_one_that_was_late_is_not_listened_to_any_more(tmp_path, monkeypatch):
    monkeypatch.setattr(film_process, "_NEXT_S", 1.0)
    film = FilmReader(write_clip(tmp_path / "clip.mp4", steady(40)))
    assert film.read(3) is not None
    os.kill(film._process.pid, signal.SIGSTOP)
    for index in (20, 30):
        with pytest.raises(VideoError, match="takes longer than 1 s"):
            film.read(index)
        assert film._process.ended


def test_a_film_that_is_gone_before_its_first_picture_is_told_each_time(tmp_path):
    path = write_clip(tmp_path / "clip.mp4", steady(4))
    film = FilmReader(path)
    path.unlink()
    for reads in (film.read, film.read, lambda index: list(film.frames(index))):
        with pytest.raises(VideoError, match="no such file"):
            reads(2)


def test_an_error_of_its_own_is_told(tmp_path):
    film = FilmReader(write_clip(tmp_path / "clip.mp4", steady(4)))
    with pytest.raises(VideoError, match="FFmpeg ended: exit code 1: IndexError"):
        film.read(99)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("index", "most_s"), [(4, 60), (5, 460), (2, 460)])
def test_only_to_go_to_a_frame_may_take_long(tmp_path, monkeypatch, index, most_s):
    film = FilmReader(write_clip(tmp_path / "clip.mp4", steady(40)))
    film._most_s = 460.0
    assert film.read(3) is not None
    monkeypatch.setattr(ChildProcess, "able_s", lambda *_: 460.0)
    with pytest.raises(VideoError, match=f"takes longer than {most_s} s"):
        film.read(index)


@pytest.mark.parametrize(("total", "most"), [(2 << 30, 1 << 30), (64 << 30, 4 << 30)])
def test_pictures_have_at_most_half_of_the_machines_memory(tmp_path, monkeypatch, total, most):
    bounds = []
    monkeypatch.setattr(film_process, "_bound_memory", bounds.append)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=total))
    film = film_process._FilmWorker(SimpleNamespace(send=lambda message: None))
    with os.fdopen(make_memory(WIDTH * HEIGHT * 3)) as memory:
        path = write_clip(tmp_path / "clip.mp4", steady(4))
        film.answer(film_process._OpenFilm(os.fsencode(path), memory.fileno(), None))
        film.answer(film_process._BeginFrames(WIDTH, HEIGHT))
    assert bounds[-1] == most


@pytest.mark.slow
def test_a_recording_of_many_files_has_not_as_many_processes(tmp_path, monkeypatch):
    path = write_clip(tmp_path / "video.mp4", steady(4))
    for k in (1, 2, 3):
        shutil.copy(path, tmp_path / f"video.{k}.mp4")
    firsts = count(0, 4)
    monkeypatch.setattr(recording_parts, "_place", lambda tags: (next(firsts), 0))
    others = len(psutil.Process().children())
    with VideoFile.open(path) as video:
        assert len(psutil.Process().children()) == others + 1
        assert [number_of(frame.image) for frame in video.frames()] == [*range(4)] * 4
        assert number_of(video.read(14).image) == 2
    assert len(psutil.Process().children()) == others


def test_a_decoder_that_is_read_with_is_lent_to_nobody(tmp_path, monkeypatch):
    (part,) = read_parts(write_clip(tmp_path / "clip.mp4", steady(4)))
    reading, lent = FilmReader.read, []

    def read(film, index):
        lent.append(part.reader())  # as another thread may ask for in the meantime
        assert film not in lent
        return reading(film, index)

    monkeypatch.setattr(FilmReader, "read", read)
    assert [number_of(part.read(k)) for k in (3, 1)] == [3, 1]
    for reader in (part, *lent):
        reader.close()
