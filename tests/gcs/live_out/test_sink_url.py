"""Addresses to tell of a flight are checked before anything starts."""

import pytest

from gcs.errors import GcsError
from gcs.live_out.sink_url import check_separate, parse_publish_url
from tests.support.bundled import SWARM
from tests.support.command_line import run_gcs


def test_an_address_is_taken_apart():
    url = parse_publish_url("json+tcp://0.0.0.0:5006?open")
    assert (url.scheme, url.host, url.port, url.text) == ("json+tcp", "0.0.0.0", 5006, "json+tcp://0.0.0.0:5006")


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("", "no such address"),
        ("udp://127.0.0.1:5005", "no such address; write json+udp://"),
        ("json+udp://127.0.0.1", "no port"),
        ("json+udp://127.0.0.1:0", "'0' is no port; ports are 1 to 65535"),
        ("json+udp://127.0.0.1:70000", "'70000' is no port"),
        ("json+udp://127.0.0.1:-1", "'-1' is no port"),
        ("json+udp://127.0.0.1:nan", "'nan' is no port"),
        ("json+udp://127.0.0.1:1e3", "'1e3' is no port"),
        ("json+udp://:5005", "no host"),
        ("json+udp://[::1]:5005", "IPv6"),
        ("json+udp://127.0.0.1:5005?rw", "no option rw of json+udp; there are none"),
        ("json+tcp://192.168.1.2:5005", "?open"),
        ("json+tcp://0.0.0.0:5005", "?open"),
    ],
)
def test_what_is_no_address_is_one_clear_line(url, why):
    with pytest.raises(GcsError) as error:
        parse_publish_url(url)
    assert why in str(error.value)
    assert f"--publish {url}" in str(error.value)


def test_nothing_else_goes_to_a_telemetry_link():
    links = ("udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600", "udpout:192.168.1.3:14551?rw=11")
    check_separate([parse_publish_url("json+udp://127.0.0.1:5005")], links)
    for port in (14550, 14551):
        with pytest.raises(GcsError, match=f"port {port} is that of udp"):
            check_separate([parse_publish_url(f"json+udp://127.0.0.1:{port}")], links)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("replay", SWARM, "--publish", "json+udp://127.0.0.1:x"), "'x' is no port"),
        (("replay", SWARM, *["--publish", "json+udp://127.0.0.1:9"] * 2), "given twice"),
        (
            (
                *("fly", SWARM / "session.toml", "-l", "udpin:127.0.0.1:14999", "--headless"),
                *("--publish", "json+udp://127.0.0.1:14999"),
            ),
            "port 14999 is that of udpin",
        ),
    ],
)
def test_a_command_with_a_wrong_address_starts_nothing(words, why, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, told = run_gcs(*words)
    assert (code, out) == (2, "")
    assert why in told
    assert not list(tmp_path.iterdir())
