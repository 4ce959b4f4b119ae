import math
import os
import socket
import sys
import threading
import time

import pytest

from mavlink.errors import LinkError
from mavlink.links.kinds import parse_url
from mavlink.links.url import LinkUrl
from mavlink.protocol.encoder import MavlinkEncoder
from tests.support.ports import free_port
from tests.support.receiving import HOST, open_reader, wait_for
from tests.support.waiting import until


@pytest.fixture
def listener():
    link = open_reader(f"udpin:{HOST}:{free_port()}", 3)
    yield link
    link.close()


@pytest.fixture
def sender():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        yield sock


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("udpin:0.0.0.0:14550", LinkUrl(scheme="udpin", host="0.0.0.0", port=14550)),
        ("udpin://0.0.0.0:14550", LinkUrl(scheme="udpin", host="0.0.0.0", port=14550)),
        ("udp:127.0.0.1:14551", LinkUrl(scheme="udpin", host="127.0.0.1", port=14551)),
        ("udp://:14540", LinkUrl(scheme="udpin", host="0.0.0.0", port=14540)),
        ("14550", LinkUrl(scheme="udpin", host="0.0.0.0", port=14550)),
        ("udpin:14560", LinkUrl(scheme="udpin", host="0.0.0.0", port=14560)),
        ("udpout:10.0.0.2:14550", LinkUrl(scheme="udpout", host="10.0.0.2", port=14550)),
        ("udpout://gcs.local:14550/", LinkUrl(scheme="udpout", host="gcs.local", port=14550)),
        ("tcp:127.0.0.1:5762", LinkUrl(scheme="tcp", host="127.0.0.1", port=5762)),
        ("tcpout://127.0.0.1", LinkUrl(scheme="tcp", host="127.0.0.1", port=5760)),
        ("TCPIN:0.0.0.0:5760", LinkUrl(scheme="tcpin", host="0.0.0.0", port=5760)),
        ("tcpin://:5761", LinkUrl(scheme="tcpin", host="0.0.0.0", port=5761)),
        ("/dev/ttyUSB0,57600", LinkUrl(scheme="serial", device="/dev/ttyUSB0", baud=57600)),
        ("/dev/ttyACM0", LinkUrl(scheme="serial", device="/dev/ttyACM0", baud=57600)),
        ("serial:///dev/ttyUSB0:115200", LinkUrl(scheme="serial", device="/dev/ttyUSB0", baud=115200)),
        ("serial:/dev/ttyUSB0:9600", LinkUrl(scheme="serial", device="/dev/ttyUSB0", baud=9600)),
        ("serial:///tmp/radio:9600", LinkUrl(scheme="serial", device="/tmp/radio", baud=9600)),
        ("serial://COM3:9600", LinkUrl(scheme="serial", device="COM3", baud=9600)),
        ("COM7,115200", LinkUrl(scheme="serial", device="COM7", baud=115200)),
    ],
)
def test_both_dialects_of_urls(url, expected):
    assert parse_url(url) == expected
    assert parse_url(expected.name) == expected


@pytest.mark.parametrize(
    "url",
    [
        "",
        "foo",
        "udpin:a:b:c",
        "udpout:",
        "udp:0.0.0.0:99999",
        "0",
        "udpin:[::1]:14550",
        "/dev/ttyUSB0,fast",
        "tcp::5760",
    ],
)
def test_bad_urls_say_how(url):
    with pytest.raises(LinkError) as caught:
        parse_url(url)
    assert repr(url) in str(caught.value) and "\n" not in str(caught.value)


def test_udp_packets_arrive_stamped_and_counted(listener, sender):
    frames = [MavlinkEncoder(i).heartbeat() for i in range(1, 101)]
    before_us = time.time_ns() // 1000
    for frame in frames:
        sender.sendto(frame, (HOST, listener.port))
    packets = wait_for(listener, 100)
    after_us = time.time_ns() // 1000
    assert [p.raw for p in packets] == frames
    assert {p.link for p in packets} == {3}
    times = [p.t_us for p in packets]
    assert times == sorted(times) and before_us - 1000 <= times[0] and times[-1] <= after_us
    counts = listener.counts
    assert (counts.packets, counts.bytes, counts.bad, counts.dropped) == (100, sum(map(len, frames)), 0, 0)
    assert 0 <= counts.silent_s <= (time.time_ns() // 1000 - before_us) * 1e-6


def test_udp_asks_for_a_large_buffer_and_says_what_it_got(listener):
    assert listener.buffer_bytes >= 200_000
    assert math.isinf(listener.counts.silent_s)


def test_poison_of_a_stranger_costs_nobody_anything(listener, sender):
    frames, packets = [MavlinkEncoder(i % 250 + 1).heartbeat() for i in range(400)], []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for i, frame in enumerate(frames):
            sender.sendto(frame, (HOST, listener.port))
            if i % 2:
                stranger.sendto(
                    (b"\xfd\xff\x00", b"\xfd\xff\x01", frame[:9], b"\n\nInit")[i % 4], (HOST, listener.port)
                )
            if i % 100 == 99:  # no more than any system's buffer holds
                packets += wait_for(listener, 100)
    assert [p.raw for p in packets] == frames
    assert listener.counts.junk_bytes > 0


def test_port_in_use_names_the_port_and_the_owner(listener):
    with pytest.raises(LinkError, match=rf"UDP port {listener.port} is in use") as caught:
        open_reader(f"udpin:{HOST}:{listener.port}")
    if os.path.exists("/proc/net/udp"):  # noqa: PTH110
        assert f"process {os.getpid()}" in str(caught.value)


def test_listening_elsewhere_is_refused():
    with pytest.raises(LinkError, match="cannot listen"):
        open_reader("udpin:192.0.2.1:14550")


def test_udp_answers_only_those_who_spoke_mavlink(listener, sender):
    with pytest.raises(LinkError, match="no receiver"):
        listener.send(b"x")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind((HOST, 0))
        stranger.sendto(b"\xfd\xff\x00", (HOST, listener.port))
        sender.sendto(MavlinkEncoder(1).heartbeat(), (HOST, listener.port))
        assert len(wait_for(listener, 1)) == 1
        listener.send(b"hello")
        sender.settimeout(60.0)
        assert sender.recv(100) == b"hello"
        stranger.settimeout(0.05)
        with pytest.raises(TimeoutError):
            stranger.recv(100)


def test_udp_out_is_silent_until_it_sends(sender):
    sender.settimeout(0.05)
    link = open_reader(f"udpout:{HOST}:{sender.getsockname()[1]}")
    assert link.read(0.02) == []
    with pytest.raises(TimeoutError):
        sender.recv(100)
    link.send(MavlinkEncoder(255).heartbeat())
    data, address = sender.recvfrom(100)
    assert data == MavlinkEncoder(255).heartbeat()
    sender.sendto(MavlinkEncoder(7).heartbeat(), address)
    assert [p.system_id for p in wait_for(link, 1)] == [7]
    link.close()


def test_udp_out_to_nobody_goes_on():
    link = open_reader(f"udpout:{HOST}:{free_port()}")
    for _ in range(3):
        link.send(b"anybody?")
        assert link.read(0.02) == []
    link.close()


def test_closing_wakes_a_reader(listener):
    got = []
    thread = threading.Thread(target=lambda: got.append(listener.read(0.3)))
    thread.start()
    listener.close()
    thread.join(60.0)
    assert got == [[]]
    assert listener.read(0.0) == []
    listener.close()


def test_tcp_out_connects_again():
    with socket.create_server((HOST, 0)) as server:
        port = server.getsockname()[1]
        link = open_reader(f"tcp:{HOST}:{port}", 2)
        frame = MavlinkEncoder(1).heartbeat()
        for round_ in range(2):
            server.settimeout(0.01)
            deadline, peer = time.monotonic() + 60.0, None
            while peer is None and time.monotonic() < deadline:
                assert link.read(0.05) == []
                try:
                    peer, _ = server.accept()
                except TimeoutError:
                    continue
            assert peer is not None
            with peer:
                peer.sendall(b"Init" + frame[:5])
                assert link.read(0.5) == []
                peer.sendall(frame[5:])
                assert [(p.raw, p.link) for p in wait_for(link, 1)] == [(frame, 2)]
                link.send(b"answer")
                peer.settimeout(60.0)
                assert peer.recv(100) == b"answer"
                assert link.connections == round_ + 1
        assert wait_for(link, 1, 0.2) == []
        link.close()
    assert link.counts.packets == 2


def test_tcp_out_waits_for_a_server_without_raising():
    link = open_reader(f"tcp:{HOST}:{free_port(socket.SOCK_STREAM)}")
    assert link.read(0.05) == [] and not link.connected
    with pytest.raises(LinkError, match="not connected"):
        link.send(b"x")
    link.close()
    assert link.read(0.01) == []


def test_tcp_in_parses_every_connection_by_itself():
    link = open_reader(f"tcpin:{HOST}:{free_port(socket.SOCK_STREAM)}")
    a, b = MavlinkEncoder(1).heartbeat(), MavlinkEncoder(2).heartbeat()
    with pytest.raises(LinkError, match="no sender of good frames"):
        link.send(b"x")
    with socket.create_connection((HOST, link.port)) as one, socket.create_connection((HOST, link.port)) as two:
        one.sendall(a[:11])
        assert wait_for(link, 1, 0.15) == []
        two.sendall(b * 3)
        assert [p.system_id for p in wait_for(link, 3)] == [2, 2, 2]
        one.sendall(a[11:])
        assert [p.system_id for p in wait_for(link, 1)] == [1]
        assert link.clients == 2
        link.send(b"both")
        one.settimeout(60.0)
        two.settimeout(60.0)
        assert one.recv(9) == two.recv(9) == b"both"
    came = []
    assert until(lambda: came.extend(link.read(0.01)) or link.clients == 0)
    assert came == []
    with pytest.raises(LinkError, match=rf"TCP port {link.port} is in use"):
        open_reader(f"tcpin:{HOST}:{link.port}")
    link.close()
    assert link.read(0.01) == []


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo terminals on this system")
def test_serial_port():
    controller, device = os.openpty()
    name = os.ttyname(device)
    link = open_reader(f"{name},57600", 4)
    frame = MavlinkEncoder(9, version=1).heartbeat()
    os.write(controller, b"\xfe\xff" + frame[:6])
    assert wait_for(link, 1, 0.1) == []
    os.write(controller, frame[6:])
    # the false start claims more bytes than came, so the frame comes out with what follows
    os.write(controller, frame * 16)
    packets = wait_for(link, 17)
    assert [(p.raw, p.link) for p in packets] == [(frame, 4)] * 17
    link.send(b"out")
    assert os.read(controller, 10) == b"out"
    os.close(controller)
    os.close(device)
    assert link.read(0.05) == []
    link.close()
    assert link.read(0.0) == []


def test_no_such_serial_port():
    with pytest.raises(LinkError, match="is it plugged in"):
        open_reader("/dev/ttyNowhere,57600")


@pytest.mark.parametrize("url", ["tcp:nowhere..bad:5760", "udpout:nowhere..bad:14550"])
def test_no_such_host(url):
    with pytest.raises(LinkError, match="no such host"):
        open_reader(url)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux counts what it drops")
def test_what_the_system_drops_is_counted(listener, sender):
    frame = MavlinkEncoder(1).heartbeat()
    # a small datagram takes some 800 bytes of the buffer
    sent = listener.buffer_bytes // 400
    for _ in range(sent):
        sender.sendto(frame, (HOST, listener.port))
    packets = []
    while more := listener.read(0.3):
        packets += more
    sender.sendto(frame, (HOST, listener.port))

    def is_accounted_for():
        packets.extend(listener.read(0.01))
        # so much at once is a flood: of what comes next not all is let in
        return len(packets) + listener.counts.dropped + listener.counts.turned_away == sent + 1

    assert until(is_accounted_for)
    assert listener.counts.dropped > 0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux hands over many datagrams at once")
def test_nothing_is_stamped_earlier_than_it_was_sent_by_a_reader_that_was_held_up(listener, sender):
    datagrams = listener._datagrams
    assert datagrams is not None
    receive, sent_us = datagrams.receive, []

    def held_up():
        time.sleep(0.05)
        sent_us.append(time.time_ns() // 1000)
        sender.sendto(MavlinkEncoder(7).heartbeat(), (HOST, listener.port))
        return receive()

    datagrams.receive = held_up
    (arrived_us,) = listener.read_batch().times_us
    assert sent_us[0] <= arrived_us <= time.time_ns() // 1000
