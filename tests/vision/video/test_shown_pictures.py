"""Films whose container has players show something else than what is coded in order: trimmed, turned, drawn out."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from tests.support.video_senders import HEIGHT, WIDTH, image, number_of, remuxed, steady, write_clip
from vision.errors import VideoError
from vision.video.coded_frames import CodedFilm
from vision.video.video import VideoFile

FRAMES = 60


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("gop", "copied"), [(12, 12 * 3), (250, 0)])
def test_a_trimmed_film_begins_with_the_frame_that_players_show_first(gop, copied, tmp_path):
    clip = write_clip(tmp_path / "clip.mp4", steady(FRAMES), gop=gop)
    path = remuxed(clip, tmp_path / "cut.mp4", earlier_ms=int(steady(FRAMES)[17]))
    with VideoFile.open(path) as video:
        assert video.n == FRAMES - 17
        shown = list(video.frames())
        assert [number_of(frame.image) for frame in shown] == list(range(17, FRAMES))
        assert [frame.t_us for frame in shown] == pytest.approx(np.arange(video.n) * 40_000, abs=1000)
        for index in (0, 40, 3, 20):
            assert number_of(video.read(index).image) == index + 17
    # no copy hides frames: it begins with the next key frame
    if copied:
        with CodedFilm(path) as film:
            assert len(list(film.frames())) == copied
    else:
        with pytest.raises(VideoError, match="only key frame is trimmed away"):
            CodedFilm(path)


@pytest.mark.slow_but_first
@pytest.mark.parametrize("turned", [90, 180, -90])
def test_pictures_are_turned_as_the_container_asks(turned, tmp_path):
    path = remuxed(write_clip(tmp_path / "clip.mp4", steady(9)), tmp_path / "turned.mp4", turned=turned)
    with av.open(str(path)) as container:
        assert next(container.decode(video=0)).rotation % 360 == turned % 360
    with VideoFile.open(path) as video:
        assert (video.width, video.height) == ((WIDTH, HEIGHT) if turned == 180 else (HEIGHT, WIDTH))
        assert f"coded {WIDTH}×{HEIGHT} px, turned by" in video.shown_as
        for frame in video.frames():
            assert frame.image.shape == (video.height, video.width, 3)
            assert number_of(np.rot90(frame.image, -turned // 90)) == frame.index
    with CodedFilm(path) as film:
        assert film.turned
        assert film.size == (video.width, video.height)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("aspect", "size"), [("4:3", (213, HEIGHT)), ("1:2", (WIDTH, 2 * HEIGHT)), ("1:1", (WIDTH, HEIGHT))]
)
def test_pixels_that_are_not_square_are_drawn_out(aspect, size, tmp_path):
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(*map(int, aspect.split(":")))
        for number in range(5):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image(number), format="bgr24")))
        container.mux(stream.encode(None))
    with VideoFile.open(path) as video:
        assert (video.width, video.height) == size
        assert bool(video.shown_as) == (aspect != "1:1")
        assert all(frame.image.shape == (*size[::-1], 3) for frame in video.frames())


def test_a_cover_picture_is_not_the_film(tmp_path):
    path = remuxed(write_clip(tmp_path / "clip.mp4", steady(FRAMES)), tmp_path / "film.mkv", cover=True)
    with av.open(str(path)) as container:
        assert len(container.streams.video) == 2
    with VideoFile.open(path) as video:
        assert [number_of(frame.image) for frame in video.frames()] == list(range(FRAMES))
        assert number_of(video.read(30).image) == 30
    with CodedFilm(path) as film:
        assert len(list(film.frames())) == FRAMES


@pytest.mark.slow_but_first
@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
@pytest.mark.parametrize(
    ("hidden", "turned", "aspect", "cover"),
    [
        (17, 90, 1, False),
        (17, 0, Fraction(4, 3), False),
        (17, 0, 1, True),
        (0, 90, Fraction(4, 3), False),
        (0, -90, Fraction(1, 2), True),
        (0, 180, Fraction(4, 3), False),
        (17, -90, Fraction(4, 3), True),
    ],
)
def test_several_of_these_at_once(suffix, hidden, turned, aspect, cover, tmp_path):
    hidden = hidden if suffix != "mkv" else 0  # it has no edit lists
    clip = write_clip(tmp_path / "clip.mp4", steady(FRAMES), aspect=aspect)
    earlier_ms = int(steady(FRAMES)[hidden])
    path = remuxed(clip, tmp_path / f"film.{suffix}", earlier_ms=earlier_ms, turned=turned, cover=cover)
    wide, high = (round(WIDTH * max(aspect, 1)), round(HEIGHT / min(aspect, 1)))
    with VideoFile.open(path) as video:
        assert (video.width, video.height) == ((wide, high) if turned % 180 == 0 else (high, wide))
        upright = [np.rot90(frame.image, -turned // 90) for frame in video.frames()]
        assert [number_of(cv2.resize(each, (WIDTH, HEIGHT))) for each in upright] == list(range(hidden, FRAMES))
        assert video.times_us == pytest.approx(np.arange(video.n) * 40_000, abs=1000)


def test_time_stamps_that_begin_again_are_refused(tmp_path):
    one = write_clip(tmp_path / "one.ts", steady(FRAMES)).read_bytes()
    (tmp_path / "two.ts").write_bytes(one + one)
    with pytest.raises(VideoError, match=rf"time stamps begin again after {FRAMES} of {2 * FRAMES} frames"):
        VideoFile.open(tmp_path / "two.ts")


def test_time_stamps_that_were_set_back_by_tenths_of_a_second_are_refused(tmp_path):
    one, other = (
        write_clip(tmp_path / f"{ms}.ts", steady(FRAMES) + ms).read_bytes() for ms in (0, int(steady(FRAMES)[-1]) - 300)
    )
    (tmp_path / "two.ts").write_bytes(one + other)
    with pytest.raises(VideoError, match=rf"time stamps begin again after {FRAMES} of {2 * FRAMES} frames"):
        VideoFile.open(tmp_path / "two.ts")


def test_a_few_frames_of_another_film_in_front_are_refused(tmp_path):
    ten_a_second = 100 * np.arange(FRAMES)
    few = write_clip(tmp_path / "few.ts", ten_a_second[:12]).read_bytes()
    one = write_clip(tmp_path / "one.ts", ten_a_second).read_bytes()
    (tmp_path / "two.ts").write_bytes(few + one)
    with pytest.raises(VideoError, match=r"time stamps begin again after 12 of"):
        VideoFile.open(tmp_path / "two.ts")
