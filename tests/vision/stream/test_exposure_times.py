"""Streams that say when their frames were taken: the frames' times are that, and not when they came."""

import socket
import struct
import threading
import time
from fractions import Fraction

import av
import pytest

from tests.support.ports import free_port
from tests.support.video_senders import COUNT, FPS, PIECE, image, pack
from tests.support.waiting import until
from vision.stream.exposure_times import EARLY_S, LATE_S, Exposures, klv_time_s, sei_time_s, sender_report
from vision.stream.stream import VideoStream

DELAY_S = 0.36
UNIX_S = 1_795_318_171.737752
KEY = bytes.fromhex("060e2b34020b01010e01030101000000")


def sei_field(unix_s):
    """The MISP time stamp: status and eight bytes of time with 0xFF after every second one."""
    t = round(unix_s * 1e6).to_bytes(8, "big")
    return b"MISPmicrosectime\x1f" + t[:2] + b"\xff" + t[2:4] + b"\xff" + t[4:6] + b"\xff" + t[6:]


def sei_nal(unix_s):
    body = sei_field(unix_s)
    return b"\0\0\0\1\x06\x05" + bytes([len(body)]) + body + b"\x80"


def klv(unix_s, long_form=False):
    """A UAS data set with its time first, then a tag 13 (latitude)."""
    body = b"\x02\x08" + round(unix_s * 1e6).to_bytes(8, "big") + b"\x0d\x04\0\0\0\1"
    length = b"\x81" + bytes([len(body)]) if long_form else bytes([len(body)])
    return b"\xfc\x00\x01\xdf\x00" + KEY + length + body


def report(unix_s, rtp_time, source=1):
    ntp = unix_s + 2_208_988_800
    seconds = int(ntp)
    return struct.pack("!BBHIIIIII", 0x80, 200, 6, source, seconds, int((ntp - seconds) * 2**32), rtp_time, 0, 0)


def test_each_way_of_telling_is_read():
    assert sei_time_s(b"\0\0\0\1\x67abc" + sei_nal(UNIX_S) + b"\0\0\0\1\x65data") == pytest.approx(UNIX_S, abs=1e-5)
    assert klv_time_s(klv(UNIX_S)) == klv_time_s(klv(UNIX_S, long_form=True)) == pytest.approx(UNIX_S, abs=1e-5)
    told = sender_report(report(UNIX_S, 90_000, source=7) + b"\x81\xca\0\0")
    assert (told.source, told.time) == (7, 90_000) and told.unix_s == pytest.approx(UNIX_S, abs=1e-5)


@pytest.mark.parametrize("cut", [0, 1, 12, 20, 27])
def test_what_is_cut_short_or_something_else_tells_nothing(cut):
    assert sei_time_s(sei_nal(UNIX_S)[: 7 + cut]) is None
    assert klv_time_s(klv(UNIX_S)[: 5 + min(cut, 26)]) is None
    assert sender_report(report(UNIX_S, 0)[:cut]) is None
    assert sender_report(b"\x80\xc9" + report(UNIX_S, 0)[2:]) is None
    assert sei_time_s(sei_field(UNIX_S).replace(b"\xff", b"\0")) is None


@pytest.mark.parametrize(
    ("delay_s", "usable"), [(0.0, True), (LATE_S - 0.1, True), (-EARLY_S - 0.01, False), (60.0, False)]
)
def test_a_senders_clock_is_believed_where_it_agrees_with_arrivals(delay_s, usable):
    exposures = Exposures()
    assert exposures.unix_s(5.0) is None
    exposures.add("SEI", 5.0, UNIX_S, UNIX_S + delay_s)
    assert (exposures.unix_s(6.0) == UNIX_S + 1.0) if usable else exposures.unix_s(6.0) is None
    assert bool(exposures.source) == usable and bool(exposures.error_s) != usable


class _Sink:
    def __init__(self):
        self.data = b""

    def write(self, data):
        self.data += data
        return len(data)


def transport_stream(first_s, *, sei=False, metadata=False):
    """Datagrams of each of COUNT frames, the first of which was taken at a Unix time."""
    sink, pieces = _Sink(), []
    with av.open(sink, "w", format="mpegts", options={"flush_packets": "1", "pat_period": "0.1"}) as container:
        options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "bframes=0:repeat-headers=1"}
        stream = container.add_stream("libx264", rate=FPS, options=options)
        stream.width, stream.height, stream.pix_fmt, stream.codec_context.gop_size = 160, 96, "yuv420p", 10
        beside = container.add_data_stream("klv") if metadata else None
        for number in range(COUNT):
            taken_s = first_s + number / FPS
            frame = av.VideoFrame.from_ndarray(image(number), format="bgr24")
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            for packet in stream.encode(frame):
                if sei:
                    told = av.Packet(sei_nal(taken_s) + bytes(packet))
                    told.pts, told.dts, told.time_base = packet.pts, packet.dts, packet.time_base
                    told.stream, told.is_keyframe, packet = stream, packet.is_keyframe, told
                container.mux(packet)
            if beside is not None:
                said = av.Packet(klv(taken_s))
                said.pts = said.dts = number * 90_000 // FPS
                said.time_base, said.stream = Fraction(1, 90_000), beside
                container.mux(said)
            data, sink.data = sink.data, b""
            pieces.append([data[at : at + PIECE] for at in range(0, len(data), PIECE)])
    return pieces


def by_frame(datagrams):
    """RTP packets put together by their time."""
    frames = {}
    for data in datagrams:
        frames.setdefault(int.from_bytes(data[4:8], "big"), []).append(data)
    return list(frames.items())


def times_of(port, url, play):
    """Times of listed frames, Unix s, and how the stream says that they are known."""
    rows = []
    with VideoStream(url, on_frame=lambda index, t_us: rows.append((index, t_us * 1e-6))) as stream:
        thread = threading.Thread(target=play, args=(port,))
        thread.start()
        while thread.is_alive():
            stream.latest(0.1)
        thread.join()
        assert until(lambda: len(rows) >= COUNT - 5)
        return rows, stream.exposure


def assert_taken(rows, first_s):
    """Frames have the times at which they were taken; times go on from those of before the first report."""
    late = [t_s - (first_s + index / FPS) for index, t_s in rows[26:]]
    assert len(late) > 5 and max(map(abs, late)) < 0.03, late


def send_at(sock, port, pieces, first_s, also=()):
    for number, datagrams in enumerate(pieces):
        time.sleep(max(0.0, first_s + DELAY_S + number / FPS - time.time()))
        for data in datagrams:
            sock.sendto(data, ("127.0.0.1", port))
        for control, made in also:
            if (said := made(number)) is not None:
                sock.sendto(said, ("127.0.0.1", control))


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("options", "words"), [({"sei": True}, "SEI"), ({"metadata": True}, "KLV")])
def test_transport_streams_with_time_stamps_or_metadata(options, words):
    port, began = free_port(), []

    def play(port):
        pieces = transport_stream(first_s := time.time() + 1.2 - DELAY_S, **options)
        began.append(first_s)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            send_at(sock, port, pieces, first_s)

    rows, told = times_of(port, f"udp://127.0.0.1:{port}", play)
    assert words in told
    assert_taken(rows, began[0])


@pytest.mark.slow_but_first
@pytest.mark.parametrize("shared", [True, False], ids=["on one port", "on the next port"])
def test_rtp_with_sender_reports(shared):
    port = free_port() & ~1
    frames, began = by_frame(pack("h264")[1]), []

    def play(port):
        began.append(first_s := time.time() + 0.8 - DELAY_S)
        source = int.from_bytes(frames[0][1][0][8:12], "big")

        def said(number):
            return report(first_s + number / FPS, frames[number][0], source) if number % 5 == 4 else None

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            reports = [(port if shared else port + 1, said)]
            send_at(sock, port, [datagrams for _, datagrams in frames[:COUNT]], first_s, reports)

    rows, told = times_of(port, f"rtp://127.0.0.1:{port}", play)
    assert "RTCP" in told
    assert_taken(rows, began[0])


def test_a_sender_whose_clock_is_not_set_is_told_and_not_believed():
    port = free_port()

    def play(port):
        pieces = transport_stream(time.time() - 3600.0, sei=True)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            send_at(sock, port, pieces, time.time())

    began_s = time.time()
    rows, told = times_of(port, f"udp://127.0.0.1:{port}", play)
    assert "not used" in told and began_s < rows[-1][1] < time.time() + 2.0 / FPS
