"""A film that brings FFmpeg down, or has it go on for ever, is one line for who reads it."""

import os
import signal

import psutil
import pytest

from tests.support.video_senders import steady, write_clip
from vision.errors import VideoError
from vision.video import film_process
from vision.video.film_process import FilmReader
from vision.video.video import VideoFile


@pytest.mark.parametrize(
    ("trouble", "told"), [(signal.SIGKILL, "FFmpeg ended: signal 9"), (signal.SIGSTOP, "FFmpeg takes longer than 1 s")]
)
@pytest.mark.parametrize("reads", [lambda film: film.read(20), lambda film: list(film.frames(20))])
def test_a_process_that_dies_or_hangs_is_one_line(tmp_path, monkeypatch, trouble, told, reads):
    monkeypatch.setattr(film_process, "_LEAST_S", 1.0)
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
