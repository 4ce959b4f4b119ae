"""Films whose pictures are something else than a screen shows: told, as they are not converted."""

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
