"""Lines that say where video comes from, also such as come from the air."""

from __future__ import annotations

import pytest

from vision.errors import VideoError
from vision.stream.port import are_one_place, bind
from vision.stream.source import offered, parse_source
from vision.stream.srt_relay import kept_back_s

NO_HOST = "h" * 70


@pytest.mark.parametrize(
    ("text", "kind", "host", "port", "codec"),
    [
        ("udp://0.0.0.0:5600", "datagrams", "", 5600, ""),
        ("udp://@:1234", "datagrams", "", 1234, ""),  # as FFmpeg writes it
        ("udp://:5600", "datagrams", "", 5600, ""),
        ("udp://127.0.0.1:5600?pkt_size=1316", "datagrams", "127.0.0.1", 5600, ""),
        ("udp://239.1.1.1:5600", "datagrams", "239.1.1.1", 5600, ""),
        ("rtp://0.0.0.0", "datagrams", "", 5600, ""),
        ("rtp://:5601?codec=H265", "datagrams", "", 5601, "hevc"),
        ("udp265://0.0.0.0:5600", "datagrams", "", 5600, "hevc"),
        ("mpegts://:5600", "datagrams", "", 5600, "mpegts"),
        ("rtsp://10.0.0.2:8554/main", "network", "", 0, ""),
        ("http://10.0.0.2/stream.ts", "network", "", 0, ""),
        ("rtmp://10.0.0.2/live", "network", "", 0, ""),
        ("/dev/video2?size=1280x720&rate=30", "camera", "", 0, ""),
        ("camera.sdp", "session", "", 0, ""),
        ("flight.mp4", "file", "", 0, ""),
    ],
)
def test_known_sources(text, kind, host, port, codec):
    source = parse_source(text)
    assert (source.kind, source.host, source.port, source.codec) == (kind, host, port, codec)
    assert source.text == text and source.paced == (kind == "file")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("udp://:5600", "rtp://@:5600", True),
        ("udp://192.0.2.1:5600", "udp://192.0.2.2:5600", True),  # told apart by sender, and bound to one port
        ("udp://:5600", "udp://127.0.0.1:5600", True),
        ("udp://127.0.0.1:5600", "udp://127.0.0.2:5600", False),
        ("udp://:5600", "udp://:5601", False),
        ("rtsp://192.0.2.1/main", "rtsp://192.0.2.1/main", True),
        ("rtsp://192.0.2.1/main", "rtsp://192.0.2.1/sub", False),
        ("rtsp://192.0.2.1/main", "udp://:5600", False),
        (f"udp://{NO_HOST}:5600", f"udp://{NO_HOST}:5600", True),
    ],
)
def test_two_sources_that_are_one_place(one, other, same):
    assert are_one_place(parse_source(one), parse_source(other)) == same


@pytest.mark.parametrize("host", [NO_HOST, "a\0b"])
def test_a_name_that_no_host_can_have_is_told(host):
    with pytest.raises(VideoError, match="cannot be the name of a host"):
        bind(host, 0)


def test_a_camera_takes_size_rate_and_format():
    source = parse_source("/dev/video0?size=1280x720&rate=30&format=mjpeg")
    assert source.address == "/dev/video0"
    assert dict(source.options) == {"video_size": "1280x720", "framerate": "30", "input_format": "mjpeg"}


@pytest.mark.parametrize(
    ("text", "waits"),
    [
        ("rtmp://0.0.0.0:1935/live", True),
        ("rtmp://:1935/live", True),
        ("rtmp://10.0.0.2/live", False),
        ("rtsp://0.0.0.0/", False),
    ],
)
def test_rtmp_to_any_address_of_ours_is_waited_for(text, waits):
    assert parse_source(text).waits == waits


@pytest.mark.parametrize(
    ("text", "address", "waits"),
    [
        ("srt://0.0.0.0:9000", "srt://0.0.0.0:9000?mode=listener&listen_timeout=35000000", True),
        ("srt://:9000?latency=80000", "srt://0.0.0.0:9000?latency=80000&mode=listener&listen_timeout=35000000", True),
        ("srt://10.0.0.2:9000?streamid=read:cam", "srt://10.0.0.2:9000?streamid=read%3Acam&mode=caller", False),
        ("srt://[::1]:9000", "srt://[::1]:9000?mode=caller", False),
    ],
)
def test_srt_waits_for_a_sender_at_an_address_of_ours_and_calls_another(text, address, waits):
    source = parse_source(text)
    assert (source.address, source.waits) == (address, waits)
    assert kept_back_s(address) == (0.08 if "latency" in text else 0.12)


def test_a_password_may_hold_what_ends_an_address():
    assert parse_source("rtsp://eve:p/w:[x@10.0.0.2/main").kind == "network"
    assert parse_source("rtsp://10.0.0.2/main@1:x").kind == "network"
    source = parse_source("rtsp://eve:pa#ss#1@10.0.0.2:8554/main?x=1#2")
    assert source.address == "rtsp://eve:pa%23ss%231@10.0.0.2:8554/main?x=1#2"
    assert "ss" not in source.text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rist://0.0.0.0:9000", "rist:// is not received: .* push RTMP to"),
        ("srt://10.0.0.2", "not an address"),
        ("srt://:9000?passphrase=0123456789", "a passphrase would stand in"),
        ("srt://:9000?transtype=file", "'transtype' is not passed on to SRT"),
        ("gopher://10.0.0.2", "no source begins with gopher"),
        ("udp://:99999", "not an address"),
        ("udp://:port", "not an address"),
        ("rtsp://10.0.0.2:99999/main", "not an address"),
        ("http://[10.0.0.2/main", "not an address"),
        ("rtp://:5600?codec=vp9", "codec 'vp9' is not known"),
        ("/dev/video0?zoom=3", "a camera has no 'zoom'"),
    ],
)
def test_what_is_no_source_is_refused_in_one_line(text, words):
    with pytest.raises(VideoError, match=words) as caught:
        parse_source(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("stream_type", "uri", "encoding", "source"),
    [
        (0, "rtsp://192.168.144.25:8554/main.264", 1, "rtsp://192.168.144.25:8554/main.264"),
        (0, "192.168.144.25:8554/main", 0, "rtsp://192.168.144.25:8554/main"),
        (1, "5600", 1, "rtp://:5600"),
        (1, "5600", 2, "rtp://:5600?codec=h265"),
        (1, "udp://192.168.1.2:5601", 0, "rtp://:5601"),  # the UAV's own address is none to listen on
        (1, "239.0.0.5:5600", 0, "rtp://239.0.0.5:5600"),
        (3, ":5602", 2, "mpegts://:5602"),
        (2, "192.168.1.2:5000", 0, "tcp://192.168.1.2:5000"),
        (2, "tcp://192.168.1.2:5000", 0, "tcp://192.168.1.2:5000"),
    ],
)
def test_offers_that_can_be_opened(stream_type, uri, encoding, source):
    assert offered(stream_type, uri, encoding) == source
    parse_source(source)


@pytest.mark.parametrize("stream_type", range(6))
@pytest.mark.parametrize(
    "uri",
    [
        *("", "/etc/passwd", "file:///etc/passwd", "/dev/video0", "concat:a|b", "subfile,,start,0,end,9,,:/etc/passwd"),
        *(
            "http://10.0.0.1/x.m3u8",
            "rtsp://a b/c",
            "rtsp://host\n/x",
            "rtsp://",
            "udp://:0",
            "99999",
            "-1",
            "rtsp://[::",
        ),
        "../secret.sdp",
    ],
)
def test_offers_that_name_no_stream_are_none(stream_type, uri):
    text = offered(stream_type, uri)
    # what is left names a network stream and nothing on this machine
    assert text == "" or parse_source(text).kind in ("network", "datagrams")
    assert not text.startswith(("http", "file", "/", "concat"))
    if stream_type > 3:
        assert text == ""
