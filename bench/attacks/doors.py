"""Doors of a flight that is under way: its folder, its terminals, its clients, its video's server, its signals."""

from __future__ import annotations

import contextlib
import os
import pty
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from bench.attacks.actors import rover, vehicle_schedules
from bench.attacks.records import frames
from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.attacks.stage import Stage, udp_to
from bench.attacks.wire import ComponentEncoder
from bench.ports import free_port
from bench.station import FlyingStation, mission_text

FLY_S = 4.0
MUTE, PATIENCE_S = 16, 90.0
MOST_SIGNALS = 300
OTHER_HOST = "127.0.0.77"
VICTIM = 'must stay = "as it is"\n'
CAME = '[session]\nformat = 1\nprogram = "x"\nstarted = 2026-01-01T00:00:00Z\n'
MOVED = "HTTP/1.1 302 Found\r\nLocation: {}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
PLAYLIST = (
    "HTTP/1.1 200 OK\r\nContent-Type: application/vnd.apple.mpegurl\r\nConnection: close\r\n\r\n"
    "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n{}a.ts\n#EXT-X-ENDLIST\n"
)
WISH = (
    b'{"variables": {"TERM": "xterm\\u0000"}, "take_over": true, '
    b'"options": {"graphics": "auto", "theme": "dark", "fps": 12, "bell": false}}'
)


def doors_of_a_flight(options: Options) -> list[AttackRow]:
    """Its folder is replaced, terminals, clients and servers misbehave, a mission came along, signals do not cease."""
    cases: dict[str, Callable[[Options], tuple[bool, str]]] = {
        "a link takes the place of the flight's folder": _linked_folder,
        "a zero byte in a terminal's wish": _zero_byte,
        "16 mute clients of json+tcp, and a 17th": _mute_clients,
        "a mission that came with a recording forwards": _forwarding_mission,
        "an HTTP camera sends on to another host": partial(_sent_on, MOVED),
        "an HTTP camera is a playlist of another host": partial(_sent_on, PLAYLIST),
        "a signal to end every 0.1 s": _ended_often,
    }
    rows = []
    for name, play in cases.items():
        held, note = play(options)
        rows.append(AttackRow(attack="doors", case=name, held=held, note=note))
    return rows


@contextlib.contextmanager
def _flight(options: Options, name: str, more: Sequence[str] = (), mission: str = "") -> Iterator[FlyingStation]:
    """A flight that one vehicle is heard in."""
    port = free_port()
    with ExitStack() as stack:
        station = FlyingStation(
            options.gcs,
            options.folder / f"door-{name}",
            mission_text([11], more=mission),
            [f"udpin:127.0.0.1:{port}"],
            more,
        )
        stack.callback(station.kill)
        sock = udp_to(port)
        stack.callback(sock.close)
        stage = Stage(vehicle_schedules(rover(11), ComponentEncoder(11), sock.send))
        stage.start()
        stack.callback(stage.stop)
        stage.wait(FLY_S)
        yield station


def _sealed(session: Path) -> bool:
    return "ended" in (session / "session.toml").read_text()


def _linked_folder(options: Options) -> tuple[bool, str]:
    with _flight(options, "link") as station:
        folder = Path(station.session)
        moved, victim = folder.with_name("moved"), options.folder / "victim"
        victim.mkdir()
        (victim / "session.toml").write_text(VICTIM)
        folder.rename(moved)
        folder.symlink_to(victim)
        time.sleep(FLY_S)
        code = station.end()
    kept = [path.name for path in victim.iterdir()] == ["session.toml"]
    kept = kept and (victim / "session.toml").read_text() == VICTIM
    count = sum(1 for _ in frames(moved))
    note = f"{'nothing' if kept else 'written'} behind the link; {count} packets in the folder, exit code {code}"
    return kept and count > 0 and _sealed(moved), note


def _zero_byte(options: Options) -> tuple[bool, str]:
    with _flight(options, "wish") as station:
        asked = _ask(station.pid)
        time.sleep(1.0)
        runs = station.running
        station.end()
    return asked and runs, ("flies on" if runs else "the flight has ended") if asked else "no socket to ask at"


def _ask(pid: int) -> bool:
    """Send the wish to where a flight waits for terminals; False where that is not found."""
    lines = Path("/proc/net/unix").read_text().splitlines()
    path = next((line.split()[-1] for line in lines if line.endswith(f"/{pid}.sock")), "")
    if not path:
        return False
    keeper, shown = pty.openpty()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection, contextlib.suppress(OSError):
        connection.settimeout(PATIENCE_S)
        connection.connect(path)
        connection.recv(65536)
        socket.send_fds(connection, [WISH], [shown])
        connection.recv(65536)
    os.close(shown)
    os.close(keeper)
    return True


def _mute_clients(options: Options) -> tuple[bool, str]:
    place = "127.0.0.1", free_port(socket.SOCK_STREAM)
    with _flight(options, "mute", ["--publish", "json+tcp://{}:{}".format(*place)]), ExitStack() as stack:
        for _ in range(MUTE):
            mute = stack.enter_context(socket.socket())
            mute.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)  # what the system holds for it counts as taken
            mute.connect(place)
        began_s, said = time.monotonic(), b""
        while not said and time.monotonic() - began_s < PATIENCE_S:
            with contextlib.suppress(OSError), socket.create_connection(place, timeout=1.0) as last:
                said = last.recv(4096)
        took_s = time.monotonic() - began_s
    return bool(said), f"told after {took_s:.1f} s" if said else f"not told within {PATIENCE_S:.0f} s"


def _forwarding_mission(options: Options) -> tuple[bool, str]:
    came = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outlet:
        outlet.bind(("127.0.0.1", 0))
        outlet.setblocking(False)
        links = f'[links]\nforward = ["udpout:127.0.0.1:{outlet.getsockname()[1]}"]\n{CAME}'
        with _flight(options, "came", mission=links) as station:
            told = "do not count" in station.output
            station.end()
        with contextlib.suppress(BlockingIOError):
            while outlet.recv(2048):
                came += 1
    return not came and told, f"{came} packets sent on; {'told' if told else 'not told'}"


def _sent_on(answer: str, options: Options) -> tuple[bool, str]:
    asked: list[int] = []
    with ExitStack() as stack:
        other = stack.enter_context(socket.create_server((OTHER_HOST, 0)))
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        goal = "http://{}:{}/".format(*other.getsockname())
        threading.Thread(target=_answer, args=(server, answer.format(goal).encode(), []), daemon=True).start()
        threading.Thread(target=_answer, args=(other, b"", asked), daemon=True).start()
        with _flight(options, "camera", ["-v", "http://{}:{}/video.m3u8".format(*server.getsockname())]) as station:
            time.sleep(FLY_S)
            station.end()
            told = any("not followed" in path.read_text() for path in Path(station.session).glob("events*.jsonl"))
    return not asked and told, f"the other host was asked {len(asked)} times; {'told' if told else 'not told'}"


def _answer(listener: socket.socket, answer: bytes, asked: list[int]) -> None:
    with contextlib.suppress(OSError):
        while True:
            client, _ = listener.accept()
            asked.append(1)
            with client, contextlib.suppress(OSError):
                client.settimeout(2.0)
                client.recv(4096)
                client.sendall(answer)


def _ended_often(options: Options) -> tuple[bool, str]:
    with _flight(options, "often") as station:
        sent = 0
        while station.running and sent < MOST_SIGNALS:
            # shells have background jobs ignore the first
            os.kill(station.pid, (signal.SIGINT, signal.SIGTERM)[sent % 2])
            sent += 1
            time.sleep(0.1)
        code = station.end()
    sealed = _sealed(Path(station.session))
    return sealed, f"{sent} signals, exit code {code}, {'sealed' if sealed else 'not sealed'}"
