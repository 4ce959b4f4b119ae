"""What leaves the station that should not: a password in a video address, and orders to ground vehicles."""

from __future__ import annotations

import select
import socket
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from bench.attacks.actors import rover, uav, vehicle_schedules
from bench.attacks.records import frames, read_events
from bench.attacks.report import AttackRow
from bench.attacks.run import Options
from bench.attacks.stage import Stage, StageCounts, udp_to
from bench.attacks.wire import ComponentEncoder
from bench.ports import free_port
from bench.station import FlyingStation, StationError, family, mission_text

PASSWORD = "Hush0xBEEF77"
FLY_S, TRY_S = 6.0, 30.0
OPERATOR = 255
"""System id of the program behind the output."""
SET_MODE = 176
ROVERS = (11, 12)


def video_password(options: Options) -> list[AttackRow]:
    """A password in the video's address: in no file, no message and no process list but the command that has it."""
    port = free_port(socket.SOCK_STREAM)
    url, keyed = f"rtsp://operator:{PASSWORD}@127.0.0.1:{port}/main", f"rtmp://127.0.0.1:{port}/live/{PASSWORD}"
    return [
        _password(options, "in the mission file", f'[links]\nvideo = "{url}"\n', (), "mission"),
        _password(options, "on the command line", "", ("-v", url), "words"),
        _password(options, "a stream's key in the mission file", f'[links]\nvideo = "{keyed}"\n', (), "key"),
    ]


def _password(options: Options, case: str, mission: str, words: Sequence[str], name: str) -> AttackRow:
    folder = options.folder / f"password-{name}"
    station = FlyingStation(
        options.gcs, folder, mission_text([11], more=mission), [f"udpin:127.0.0.1:{free_port()}"], words
    )
    try:
        tried = _tried(station.session)
        # what the user typed is the user's; what the station starts is its own
        asked = [pid for pid in family(station.pid) if not words or pid != station.pid]
        listed = [pid for pid in asked if PASSWORD in _command_line(pid)]
    finally:
        station.end()
    files = [
        path.name
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "mission.toml" and PASSWORD.encode() in path.read_bytes()
    ]
    notes = (
        ["the video was never tried"] * (not tried)
        + [f"in {name}" for name in files]
        + [f"in {len(listed)} process lists"] * bool(listed)
    )
    return AttackRow(attack="video password", case=case, held=not notes, note="; ".join(notes))


def _tried(session: Path) -> bool:
    """Whether the event log holds the video's failure, waited for: whatever names the address is written by then."""
    until_s = time.monotonic() + TRY_S
    while time.monotonic() < until_s:
        if any(event.loud and event.kind == "video" for event in read_events(session, StageCounts())):
            time.sleep(1.0)
            return True
        time.sleep(0.2)
    return False


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


class Operator:
    """A program behind an output: whatever comes is answered with commands to all systems."""

    def __init__(self) -> None:
        self._sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sock.bind(("127.0.0.1", 0))
        self._stop = threading.Event()
        self._voice = ComponentEncoder(OPERATOR, 190)
        self.sent: set[bytes] = set()
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        port: int = self._sock.getsockname()[1]
        return port

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._sock.close()

    def _answer(self) -> None:
        number = 0
        while not self._stop.wait(0.05):
            address = None
            while select.select([self._sock], [], [], 0.0)[0]:
                address = self._sock.recvfrom(2048)[1]
            for target in (*ROVERS, 1, 0) if address else ():
                number += 1  # each order is another, so that it can be found again
                raw = self._voice.command(target, SET_MODE, 1.0, 4.0, float(number))
                self.sent.add(raw)
                self._sock.sendto(raw, address)  # type: ignore[arg-type]


def behind_an_output(options: Options) -> list[AttackRow]:
    """A program behind --out commands all systems to hold: how many of its frames reach which, and what is recorded."""
    cases: list[tuple[str, str, tuple[str, ...]]] = [
        ("--out, listening only", "", ()),
        ("--out with --command", "", ("--command",)),
        ("--out …?rw with --command", "?rw", ("--command",)),
        ("--out …?rw, listening only", "?rw", ()),
    ]
    return [_ordered(options, k, *case) for k, case in enumerate(cases)]


def _ordered(options: Options, k: int, case: str, query: str, words: Sequence[str]) -> AttackRow:
    operator, port = Operator(), free_port()
    sockets = {system_id: udp_to(port) for system_id in (1, *ROVERS)}
    try:
        station = FlyingStation(
            options.gcs,
            options.folder / f"out-{k}",
            mission_text(ROVERS),
            [f"udpin:127.0.0.1:{port}"],
            ["--forward", f"udpout:127.0.0.1:{operator.port}{query}", *words],
        )
    except StationError as error:
        operator.close()
        for sock in sockets.values():
            sock.close()
        refused = "command" in str(error) and not words
        return AttackRow(attack="program behind --out", case=case, held=refused, note=f"refused: {str(error)[-120:]}")
    bodies = [uav(), *map(rover, ROVERS)]
    stage = Stage(
        [
            line
            for body in bodies
            for line in vehicle_schedules(body, ComponentEncoder(body.system_id), sockets[body.system_id].send)
        ]
    )
    stage.start()
    try:
        stage.wait(FLY_S)
        reached = {system_id: _drain(sock, operator.sent) for system_id, sock in sockets.items()}
    finally:
        operator.close()
        stage.stop()
        station.end()
        for sock in sockets.values():
            sock.close()
    orders = sum(reached.values())
    counted = Counter(raw for _, raw in frames(station.session))
    in_log = sum(counted[raw] > 0 for raw in operator.sent)
    rovers = sum(reached[i] for i in ROVERS)
    may = bool(query and words)
    held = not rovers and (orders <= in_log if may else not orders)
    note = f"{rovers} orders reached rovers, {reached[1]} the UAV; {in_log} of them in the log"
    return AttackRow(
        attack="program behind --out",
        case=case,
        false_sent=len(operator.sent),
        false_recorded=in_log,
        held=held and bool(operator.sent),
        note=note if operator.sent else "nothing came out to answer to",
    )


def _drain(sock: socket.socket, wanted: set[bytes]) -> int:
    found = 0
    while select.select([sock], [], [], 0.0)[0]:
        try:
            found += sock.recv(2048) in wanted
        except ConnectionRefusedError:
            continue
    return found
