"""The recording of the screens in the docs plays in any player of its format, and its moving picture is of it."""

import json

from PIL import Image

from tests.support.bundled import ROOT

CAST = ROOT / "docs" / "rollcall.cast"
MOST_BYTES, MOST_PICTURE_BYTES = 300_000, 1_000_000


def test_the_recording_is_valid_small_and_shows_names_map_and_help():
    assert CAST.stat().st_size < MOST_BYTES
    header, *events = map(json.loads, CAST.read_text(encoding="utf-8").splitlines())
    assert header["version"] == 2
    times = [at_s for at_s, kind, data in events if kind == "o" and isinstance(data, str)]
    assert len(times) == len(events) > 10 and times == sorted(times) and times[-1] < 60
    drawn = "".join(data for _, _, data in events)
    for words in ("REPLAY", "confirmed", "MAP", "ALARMS", "quit", "pause"):
        assert words in drawn, words


def test_the_moving_picture_is_small_and_of_the_recording():
    with Image.open(CAST.with_suffix(".gif")) as picture:
        events = CAST.read_text(encoding="utf-8").splitlines()[1:]
        assert len(events) - 8 < picture.n_frames <= len(events)
    assert CAST.with_suffix(".gif").stat().st_size < MOST_PICTURE_BYTES
