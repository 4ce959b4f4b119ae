"""The picture with names in it, as FFmpeg receives it while it is sent."""

import threading
from dataclasses import replace

import av
import numpy as np
import pytest
from av.video.frame import PictureType

from gcs.cli.sharing.publishing import publishing
from gcs.errors import GcsError
from gcs.live_out.live_out import LiveOut
from gcs.live_out.picture import MpegTsPicture, sdp
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import parse_stream_url
from gcs.report.overlay import STANDING_RGB
from tests.support.bundled import SWARM
from tests.support.command_line import run_gcs
from tests.support.ports import free_port
from tests.support.snapshots import box, snapshot

SOURCE = SinkSource(name="flight")
GREY = np.full((240, 320, 3), 90, np.uint8)
BOX = {"cx": 160.0, "cy": 150.0, "w": 80.0, "h": 40.0, "angle": 0.0}


def shown(frame, image=GREY):
    height, width = image.shape[:2]
    return replace(snapshot(frame, image=image, boxes=[box(1, 2, **BOX)]), width=width, height=height)


class Station:
    """A new picture whenever it is asked."""

    timeline = None

    def __init__(self):
        self.frame, self.said = 0, []

    def add_event(self, event):
        self.said.append((event.level, event.text))

    def latest(self):
        self.frame += 1
        return shown(self.frame)


def receive(address, frames, **options):
    """So many pictures, BGR, and how each was coded; a receiver that begins while others have received for long."""
    options |= {"fflags": "nobuffer", "analyzeduration": "500000"}
    with av.open(address, options=options, timeout=60.0) as film:
        stream = film.streams.video[0]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.has_b_frames == 0
        for frame in film.decode(stream):
            yield frame
            frames -= 1
            if not frames:
                return


def has_ink(image):
    """Whether the box's outline is there, in the colour of a tentative name."""
    ink = np.array(STANDING_RGB["tentative"][::-1])
    return (np.abs(image[120:180, 110:210].astype(int) - ink).sum(axis=2) < 120).sum() > 60


@pytest.mark.slow_but_first
@pytest.mark.parametrize("scheme", ["udp", "rtp"])
def test_a_receiver_sees_boxes_and_names_without_b_frames(scheme, tmp_path):
    url = parse_stream_url(f"{scheme}://127.0.0.1:{free_port()}")
    options = {}
    address = f"udp://127.0.0.1:{url.port}"
    if scheme == "rtp":
        address = str(tmp_path / "flight.sdp")
        (tmp_path / "flight.sdp").write_text(sdp(url), newline="")
        options = {"protocol_whitelist": "file,udp,rtp"}
    said = []
    with LiveOut(Station().latest, [url], SOURCE, lambda *trouble: said.append(trouble)):
        got = list(receive(address, 40, **options))
    assert {int(frame.pict_type) for frame in got} <= {PictureType.I, PictureType.P}
    assert (got[-1].width, got[-1].height) == (320, 240)
    assert has_ink(got[-1].to_ndarray(format="bgr24"))
    times = [frame.time for frame in got]
    assert times == sorted(times)
    assert said == []


def test_what_a_receiver_of_rtp_needs_is_written_once_and_nothing_is_written_over(tmp_path):
    station, url = Station(), parse_stream_url(f"rtp://127.0.0.1:{free_port()}")
    path = tmp_path / f"flight-{url.port}.sdp"
    with publishing(station, [url], SOURCE.name, tmp_path):
        assert path.read_bytes() == sdp(url).encode()
    assert station.said == [("info", f"{url.text}: receivers open {path}")]
    path.write_text("mine")
    with publishing(station, [url], SOURCE.name, tmp_path):
        level, text = station.said[-1]
    assert (level, path.read_text()) == ("warning", "mine")
    assert f"{path} is not written" in text


@pytest.mark.slow
def test_a_picture_of_another_size_goes_on_in_the_same_stream():
    url = parse_stream_url(f"udp://127.0.0.1:{free_port()}?width=200")
    stop = threading.Event()

    def send():
        sink, frame = MpegTsPicture(url, SOURCE), 0
        while not stop.wait(0.01):
            frame += 1
            sink.write(shown(frame, GREY if frame < 200 else np.full((100, 300, 3), 50, np.uint8)))
        sink.close()

    sending = threading.Thread(target=send)
    sending.start()
    try:
        sizes = set()
        for frame in receive(f"udp://127.0.0.1:{url.port}", 2000):
            sizes.add((frame.width, frame.height))
            if len(sizes) == 2:
                break
    finally:
        stop.set()
        sending.join(60)
    assert sizes == {(200, 150), (200, 66)}


def test_names_that_may_change_are_not_shown(monkeypatch):
    sent = []
    sink = MpegTsPicture(parse_stream_url(f"udp://127.0.0.1:{free_port()}"), SOURCE)
    monkeypatch.setattr(sink, "_encode", sent.append)
    sink.write(shown(1))
    sink.write(replace(shown(2), provisional=True))
    sink.close()
    assert [has_ink(image) for image in sent] == [True, False]


@pytest.mark.parametrize("width", ["", "nan", "-1", "0", "1e3", "159", "99999", "9" * 40])
def test_a_width_is_a_number_of_pixels(width):
    with pytest.raises(GcsError, match="width is a number of pixels from 160 to 7680"):
        parse_stream_url(f"udp://127.0.0.1:5600?width={width}")


def test_a_wrong_address_is_one_line():
    code, out, told = run_gcs("replay", SWARM, "--stream", "rtmp://127.0.0.1:5600")
    assert (code, out) == (2, "")
    assert "--stream rtmp://127.0.0.1:5600: no such address; write udp://192.168.1.20:5600 or rtp://" in told
