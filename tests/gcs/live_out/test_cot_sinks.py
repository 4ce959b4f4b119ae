"""Cursor on Target as others receive it: pytak over UDP and through a TLS server, and takproto."""

import asyncio
import configparser
import datetime
import ipaddress
import ssl
from xml.etree import ElementTree

import pytak
import pytest
import takproto
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from gcs.errors import GcsError
from gcs.export.cot import CotPacer, cot_boxes, cot_uid
from gcs.live_out.cot_sinks import CotTcp, CotTls, CotUdp
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import parse_publish_url
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from infra.wall_clock import now_us
from tests.support.bundled import SWARM, shortened
from tests.support.ports import free_port, udp_socket
from tests.support.snapshots import box, snapshot

SOURCE = SinkSource(name="swarm")
PLACE = {"lat_deg": 47.0, "lon_deg": 8.0, "place_std_m": 1.0}


@pytest.fixture(scope="module")
def snapshots(tmp_path_factory):
    """Six seconds of a recorded swarm with a stranger."""
    analysis = Analysis(open_session(shortened(SWARM, tmp_path_factory.mktemp("swarm"), 60)))
    found = list(analysis.snapshots(images=False))
    analysis.close()
    return found


def due(snapshots):
    """Uid and time in ms of all events that there should be."""
    pacer = CotPacer()
    return [
        (cot_uid(one, "swarm"), shown.t_us // 1000)
        for shown in snapshots
        for one in cot_boxes(shown)
        if pacer.due(cot_uid(one, "swarm"), shown.t_us)
    ]


def as_received(data):
    """Uid and time in ms of an event, by takproto."""
    event = takproto.parse_proto(bytearray(data.strip())).cotEvent
    assert event.staleTime - event.startTime == 10_000
    assert (event.type, event.how) in {("a-f-G-E-V", "m-f"), ("a-u-G-E-V", "m-i")}
    assert (event.detail.contact.callsign[:4] == "UGV-") == (event.type == "a-f-G-E-V")
    assert 0.0 < event.ce < 100.0
    assert event.hae == event.le == 9_999_999.0
    return event.uid, event.sendTime


async def receive(config, count, send):
    """What pytak gets while a function of ours sends."""
    parser = configparser.ConfigParser()
    parser["tak"] = config
    reader, writer = await pytak.protocol_factory(parser["tak"])
    queue = asyncio.Queue()
    work = asyncio.create_task(pytak.RXWorker(queue, parser["tak"], reader).run())
    sending = asyncio.create_task(asyncio.to_thread(send))
    try:
        got = [await asyncio.wait_for(queue.get(), 60) for _ in range(count)]
        await sending
        assert queue.empty()
    finally:
        work.cancel()
        for end in (reader, writer):
            if hasattr(end, "close"):
                end.close()
    return got


async def test_pytak_receives_every_event_by_udp(snapshots):
    port, expected = free_port(), due(snapshots)
    assert len(expected) > 20

    def send():
        sink = CotUdp(parse_publish_url(f"cot+udp://127.0.0.1:{port}"), SOURCE)
        for shown in snapshots:
            sink.write(shown)
        sink.close()

    got = await receive({"COT_URL": f"udp+ro://127.0.0.1:{port}"}, len(expected), send)
    assert [as_received(data) for data in got] == expected


@pytest.mark.filterwarnings("ignore:ssl.OP_NO_SSL:DeprecationWarning")  # pytak's own
async def test_pytak_receives_every_event_through_a_tls_server(snapshots, tmp_path):
    expected = due(snapshots)
    authority, key = make_certificate(tmp_path / "ca")
    for name in ("server", "us", "them"):
        make_certificate(tmp_path / name, authority, key)
    server = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=tmp_path / "ca.pem")
    server.load_cert_chain(tmp_path / "server.pem", tmp_path / "server.key")
    server.verify_mode = ssl.CERT_REQUIRED
    clients = []

    async def relay(reader, writer):
        clients.append(writer)
        while data := await reader.read(65_536):
            for other in clients:
                other.write(data)  # to its sender too: that has to read it
        writer.close()

    async with await asyncio.start_server(relay, "127.0.0.1", 0, ssl=server) as listening:
        port = listening.sockets[0].getsockname()[1]

        def send():
            files = "&".join(f"{key}={tmp_path / name}" for key, name in (("cert", "us.pem"), ("key", "us.key")))
            sink = CotTls(parse_publish_url(f"cot+tls://127.0.0.1:{port}?{files}&ca={tmp_path / 'ca.pem'}"), SOURCE)
            for shown in snapshots:
                sink.serve()
                sink.write(shown)
            assert sink.sent == len(expected)
            sink.close()

        config = {
            "COT_URL": f"tls://127.0.0.1:{port}",
            "PYTAK_TLS_CLIENT_CERT": str(tmp_path / "them.pem"),
            "PYTAK_TLS_CLIENT_KEY": str(tmp_path / "them.key"),
            "PYTAK_TLS_CLIENT_CAFILE": str(tmp_path / "ca.pem"),
        }
        got = await receive(config, len(expected), send)
    assert [as_received(data) for data in got] == expected


async def test_a_server_that_we_do_not_trust_gets_nothing(tmp_path):
    make_certificate(tmp_path / "other")
    trusted, key = make_certificate(tmp_path / "ca")
    make_certificate(tmp_path / "us", trusted, key)
    server = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    server.load_cert_chain(tmp_path / "other.pem", tmp_path / "other.key")
    async with await asyncio.start_server(lambda *_: None, "127.0.0.1", 0, ssl=server) as listening:
        url = f"cot+tls://127.0.0.1:{listening.sockets[0].getsockname()[1]}?ca={tmp_path / 'ca.pem'}"
        with pytest.raises(ssl.SSLCertVerificationError):
            await asyncio.to_thread(CotTls, parse_publish_url(url), SOURCE)


async def test_a_server_that_goes_is_noticed():
    async def end(reader, writer):
        writer.close()

    async with await asyncio.start_server(end, "127.0.0.1", 0) as listening:
        url = f"cot+tcp://127.0.0.1:{listening.sockets[0].getsockname()[1]}"
        sink = await asyncio.to_thread(CotTcp, parse_publish_url(url), SOURCE)

        def serve():
            for _ in range(100_000):
                sink.serve()

        with pytest.raises(ConnectionResetError):
            await asyncio.to_thread(serve)
        sink.close()


def test_events_of_a_replay_are_dated_now_and_are_no_operation():
    with udp_socket() as reader:
        reader.settimeout(30)
        url = parse_publish_url(f"cot+udp://127.0.0.1:{reader.getsockname()[1]}?interface=127.0.0.1")
        sink = CotUdp(url, SinkSource(name="old", replayed=True))
        before_us = now_us()
        for frame in range(5):
            sink.write(snapshot(frame, boxes=[box(1, 2, **PLACE)]))
        event = ElementTree.fromstring(reader.recv(2000))
        assert sink.sent == 1
        sink.close()
    told_s = datetime.datetime.fromisoformat(event.get("time")).timestamp()
    assert before_us // 1000 <= round(told_s * 1000) <= now_us() // 1000
    assert event.get("opex") == "s-replay"


@pytest.mark.parametrize(
    ("query", "why"),
    [
        ("cert=/no/such.pem", "no file /no/such.pem for cert"),
        ("ca=", "no file is named for ca"),
        ("key={file}", "add cert="),
        ("password=x", "no option password of cot+tls; there are cert, key, ca, name"),
    ],
)
def test_files_are_looked_for_before_anything_starts(query, why, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(GcsError) as error:
        parse_publish_url("cot+tls://127.0.0.1:8089?" + query.format(file=tmp_path / "file"))
    assert why in str(error.value)
    with pytest.raises(GcsError, match="interface is the IPv4 address"):
        parse_publish_url("cot+udp://239.2.3.1:6969?interface=eth0")


def make_certificate(path, issuer=None, issuer_key=None):
    """Writes ``path``.pem and ``path``.key for 127.0.0.1; of an authority where there is no issuer."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, path.name)])
    today = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(issuer.subject if issuer else name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(today - datetime.timedelta(days=1))
        .not_valid_after(today + datetime.timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=issuer is None, path_length=None), critical=True)
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=False)
    )
    certificate = builder.sign(issuer_key or key, hashes.SHA256())
    pem = serialization.Encoding.PEM
    path.with_suffix(".pem").write_bytes(certificate.public_bytes(pem))
    path.with_suffix(".key").write_bytes(
        key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return certificate, key
