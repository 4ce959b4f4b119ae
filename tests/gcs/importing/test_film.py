"""Films whose pictures are something else than a screen shows: told, as they are not converted."""

import re

import av
import numpy as np
import pytest

from gcs.importing.film import open_film


def film(path, x264):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.options = 160, 120, "yuv420p", {"x264-params": x264}
        for k in range(6):
            picture = av.VideoFrame.from_ndarray(np.full((120, 160, 3), 20 * k, np.uint8), format="rgb24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("x264", "words"),
    [
        ("keyint=5", ()),
        ("colorprim=bt709:transfer=bt709:colormatrix=bt709", ()),
        ("interlaced=1:tff=1", ("a.mp4 is interlaced",)),
        ("colorprim=bt2020:transfer=smpte2084:colormatrix=bt2020nc", ("a.mp4 is HDR (PQ)",)),
        ("colorprim=bt2020:transfer=arib-std-b67:colormatrix=bt2020nc", ("a.mp4 is HDR (HLG)",)),
        ("interlaced=1:colorprim=bt2020:transfer=arib-std-b67", ("a.mp4 is interlaced", "a.mp4 is HDR (HLG)")),
    ],
)
def test_what_pictures_are_taken_for(x264, words, tmp_path):
    said = open_film(film(tmp_path / "a.mp4", x264)).assumed
    assert len(said) == len(words)
    assert all(text.startswith(word) for text, word in zip(said, words, strict=True))


def two_films(old, new):
    tracks = [new.add_stream_from_template(old.streams.video[0]) for _ in range(2)]
    for packet in (packet for packet in old.demux(video=0) if packet.size):
        for packet.stream in tracks:
            new.mux(packet)


def slanting(old, new):
    copy = new.add_stream_from_template(old.streams.video[0])
    copy.set_display_rotation(30)
    for packet in (packet for packet in old.demux(video=0) if packet.size):
        packet.stream = copy
        new.mux(packet)


def interrupted(old, new):
    copy = new.add_stream_from_template(old.streams.video[0])
    for k, packet in enumerate(packet for packet in old.demux(video=0) if packet.size):
        later = round((k > 2) * 7 / packet.time_base)
        packet.pts, packet.dts, packet.stream = packet.pts + later, packet.dts + later, copy
        new.mux(packet)


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("made", "name", "said"),
    [
        (two_films, "b.mp4", "b.mp4 has 2 films in it"),
        # these do not tell beforehand how many frames a track has
        (two_films, "b.mkv", "b.mkv has 2 films in it"),
        (two_films, "b.ts", "b.ts has 2 films in it"),
        (slanting, "b.mp4", "b.mp4 is to be turned by"),
        (interrupted, "b.mp4", "b.mp4 has no picture for 7.0 s after frame 2"),
    ],
)
def test_what_a_container_has_that_is_not_done(made, name, said, tmp_path):
    whole = film(tmp_path / "a.mp4", "keyint=1:bframes=0")
    with av.open(str(whole)) as old, av.open(str(tmp_path / name), "w") as new:
        made(old, new)
    (words,) = open_film(tmp_path / name).assumed
    assert words.startswith(said)


@pytest.mark.parametrize("name", ["b.mp4", "b.mkv"])
def test_a_copy_that_broke_off_is_told(name, tmp_path):
    whole = tmp_path / name
    with (
        av.open("tests/data/reported/grey_film.mp4") as old,
        av.open(str(whole), "w", options={"movflags": "+faststart"} if name == "b.mp4" else {}) as new,
    ):
        copy = new.add_stream_from_template(old.streams.video[0])
        for packet in (packet for packet in old.demux(video=0) if packet.size):
            packet.stream = copy
            new.mux(packet)
    assert open_film(whole).assumed == ()
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    (words,) = open_film(whole).assumed
    assert re.fullmatch(rf"{name} ends after 1\d\.\d s of the 20\.0 s that its header tells: is it cut off\?", words)
