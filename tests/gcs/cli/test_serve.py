"""``gcs replay --serve``: the screens in a browser of this computer, and in no other page."""

import os
import re
import signal
import subprocess
from pathlib import Path

import aiohttp
import psutil
import pytest

from gcs.session.recorder import Recorder
from tests.support.bundled import CURVED_ROAD, SWARM, shortened
from tests.support.command_line import GCS, run_gcs
from tests.support.snapshots import ONE_UGV
from tests.support.waiting import until


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A second of film."""
    return shortened(CURVED_ROAD, tmp_path_factory.mktemp("served") / "flight", 10)


@pytest.fixture(scope="module")
def served(flight):
    """A replay's address, and the process that serves it."""
    with subprocess.Popen(
        [*GCS, "replay", str(flight), "--serve"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    ) as process:
        try:
            yield process.stdout.readline().strip(), process
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(60) == 0


def origin_of(address):
    return re.match(r"http://127\.0\.0\.1:\d+", address)[0]


async def status(address, **headers):
    async with aiohttp.ClientSession() as browser, browser.get(address, headers=headers) as response:
        return response.status


async def test_its_own_page_has_keys_and_asks_nobody_else(served):
    address, _ = served
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", address)
    async with aiohttp.ClientSession() as browser:
        async with browser.get(address) as page:
            text = await page.text()
            assert page.status == 200
            assert "default-src 'self'" in page.headers["Content-Security-Policy"]
            assert page.headers["Referrer-Policy"] == "no-referrer"
        assert "googleapis" not in text and "https:" not in text, "it asks nobody else for anything"
        assert "keys.focus()" in text, "keys work without a click"
        socket = re.search(r'data-session-websocket-url="(.*?)"', text)[1]
        assert socket == f"ws{address[4:]}ws"
        script = re.search(r'<script src="(.*?)"', text)[1]
        assert await status(script) == 200


@pytest.mark.slow
async def test_screens_end_with_their_page(served):
    address, process = served
    socket = f"ws{address[4:]}ws?width=120&height=40"
    headers = {"Origin": origin_of(address)}
    async with aiohttp.ClientSession() as client, client.ws_connect(socket, headers=headers) as connection:
        await Browser(connection).read_until(b"UGV-1")
        children = psutil.Process(process.pid).children(recursive=True)
        assert children
    assert until(lambda: not any(child.is_running() and child.status() != "zombie" for child in children))


async def test_without_the_secret_there_is_nothing(served):
    address, _ = served
    own = origin_of(address)
    for path in ("/", "/ws", "/static/", f"/{'A' * 32}/", f"/{'A' * 32}/ws", "/download/x", "/%2e%2e/", "//"):
        assert await status(own + path, Origin=own) == 404, path


@pytest.mark.parametrize("page", ["", "ws?width=80&height=24"])
async def test_other_sites_are_refused(served, page):
    address, _ = served
    own = origin_of(address)
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}, {"Host": "evil.example", "Origin": own}):
        assert await status(address + page, **headers) == 403, headers
    if page:
        assert await status(address + page) == 403


class Browser:
    """A browser on the screens, to its page's own protocol."""

    def __init__(self, connection):
        self.connection = connection

    async def read_until(self, word):
        screens = b""
        while word not in screens:
            message = await self.connection.receive(timeout=60)
            assert message.type in (aiohttp.WSMsgType.BINARY, aiohttp.WSMsgType.TEXT), message
            screens += message.data if message.type == aiohttp.WSMsgType.BINARY else message.data.encode()
        return screens

    async def press(self, keys):
        await self.connection.send_json(["stdin", keys])

    async def saves(self, key):
        """The name of what the page is to download."""
        await self.press(key)
        said = await self.read_until(b"deliver_file_start")
        return re.search(rb'"deliver_file_start", "(\w+)"', said)[1].decode()


def files_in(folder):
    return sorted((path, path.stat().st_size) for path in folder.rglob("*"))


async def test_pictures_are_downloads_and_nothing_is_written(served, flight):
    address, process = served
    own, here = origin_of(address), Path(psutil.Process(process.pid).cwd())
    before = [files_in(flight), sorted(here.iterdir())]
    socket = f"ws{address[4:]}ws?width=120&height=40"
    async with aiohttp.ClientSession() as client, client.ws_connect(socket, headers={"Origin": own}) as connection:
        browser = Browser(connection)
        await browser.read_until(b"UGV-1")
        for key, begins in (("S", b"<svg"), ("s", b"\x89PNG")):
            name = await browser.saves(key)
            async with client.get(f"{own}/download/{name}") as response:
                assert response.status == 200 and (await response.read()).startswith(begins)
                assert response.headers["Content-Disposition"].startswith("attachment; filename=rollcall-")
            assert await status(f"{own}/download/{name}") == 404, "once"
            assert await status(f"{own}/download/{name}", Host="evil.example") == 403
        await browser.press("m")
        await browser.read_until(b"write nothing")
    assert [files_in(flight), sorted(here.iterdir())] == before


def test_it_listens_on_the_loopback_alone(served):
    _, process = served
    listening = [each.laddr for each in psutil.Process(process.pid).net_connections() if each.status == "LISTEN"]
    assert [each.ip for each in listening] == ["127.0.0.1"]


def test_a_flight_is_never_served(tmp_path):
    code, _, told = run_gcs("fly", SWARM / "session.toml", "--serve")
    assert code == 2
    assert "a flight is never served" in told
    recorder = Recorder(tmp_path, ONE_UGV, video=False)
    try:
        code, _, told = run_gcs("replay", recorder.folder, "--serve")
    finally:
        recorder.close()
    assert code == 2
    assert "it is being flown, and a flight is never served" in told


def test_what_cannot_be_served_is_one_line(tmp_path):
    for words, why in (
        ((tmp_path / "none", "--serve"), "none"),
        ((SWARM, "--serve", "--publish", "json+udp://127.0.0.1:5005"), "--serve starts a replay for each browser"),
    ):
        code, out, told = run_gcs("replay", *words)
        assert (code, out) == (2, "")
        assert why in told
