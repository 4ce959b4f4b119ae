"""Other ground stations beside ours: do all of them see the whole fleet?

A fleet sends to our listener; the listener forwards to MAVProxy and to a MAVSDK client, each a program of its own.
Some seconds after both have begun to send, it is counted which vehicles each received: MAVProxy by the log that it
writes, MAVSDK by the systems that it lists. What they send stays here: the outputs are read-only.

    python -m bench.beside [--seconds 10] [--ground 5] [--mavproxy PATH]
"""

from __future__ import annotations

import argparse
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from bench.ports import free_port
from mavlink.forwarding.forward import Forwarder
from mavlink.forwarding.outputs import OutputCounts
from mavlink.links.base import Link
from mavlink.links.kinds import open_link
from mavlink.protocol.encoder import COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.log import Tlog

POSITION, MOST_SECONDS, START_SECONDS = 33, 60.0, 30.0
Seen = dict[int, int]
"""System id → positions received, or 1 where only the system is known."""


class SenderFleet:
    """A UAV and ground vehicles, each with a socket of its own, ten positions and one heartbeat a second."""

    def __init__(self, port: int, ground: int) -> None:
        self._to = ("127.0.0.1", port)
        self._vehicles = [
            (MavlinkEncoder(i), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for i in range(1, ground + 2)
        ]
        self._ticks = 0

    def tick(self) -> None:
        """A tenth of a second."""
        for speaker, sock in self._vehicles:
            uav = speaker is self._vehicles[0][0]
            if self._ticks % 10 == 0:
                sock.sendto(speaker.heartbeat(COPTER if uav else ROVER, custom_mode=4), self._to)
            height = (540.0, 40.0) if uav else (500.0, 0.0)
            sock.sendto(speaker.global_position_int(self._ticks * 100, 47.4, 8.5, *height), self._to)
        self._ticks += 1

    def received_bytes(self) -> int:
        """Bytes that came back to ground vehicles."""
        count = 0
        for _, sock in self._vehicles[1:]:
            sock.setblocking(False)
            try:
                while True:
                    count += len(sock.recv(4096))
            except BlockingIOError:
                continue
        return count

    def close(self) -> None:
        for _, sock in self._vehicles:
            sock.close()


def fly(link: Link, forwarder: Forwarder, fleet: SenderFleet, seconds: float) -> list[Packet]:
    """Listens and forwards for some seconds after all receivers are there; the packets received then."""
    received: list[Packet] = []
    start_s, ticks, stop_s = time.monotonic(), 0, START_SECONDS
    ready = False
    while (now_s := time.monotonic() - start_s) < stop_s:
        while ticks * 0.1 <= now_s:
            fleet.tick()
            ticks += 1
        time.sleep(0.02)
        link.maintain()
        packets = link.read_batch().packets(0)
        forwarder.forward(packets, lambda index, raw, peer: None)
        if not ready and all(each.stopped for each in forwarder.counts):
            ready, stop_s = True, now_s + seconds
        received += packets if ready else []
    return received


def positions(packets: Iterable[Packet]) -> Seen:
    return dict(Counter(packet.system_id for packet in packets if packet.message_id == POSITION))


def start_mavproxy(program: str, port: int, folder: Path) -> subprocess.Popen[bytes]:
    """MAVProxy without a terminal, writing its log into a folder."""
    command = [program, f"--master=udpin:127.0.0.1:{port}", "--daemon", "--non-interactive"]
    command += [f"--state-basedir={folder}", f"--logfile={folder / 'beside.tlog'}", "--default-modules=link"]
    command += ["--cmd=set flushlogs 1"]
    with (folder / "mavproxy.txt").open("wb") as output:
        return subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output)


def start_mavsdk(port: int, seconds: float) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "bench.beside", "--client", str(port), "--seconds", str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def mavsdk_client(port: int, seconds: float) -> None:
    """In a process of its own: lists the systems that MAVSDK finds, on the last line as JSON."""
    from mavsdk import logging
    from mavsdk.mavsdk import Configuration, Mavsdk

    logging.log_subscribe(lambda level, text, file, line: True)
    configuration = Configuration.create_manual(245, 190, True)
    with Mavsdk(configuration) as sdk:
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        found: set[int] = set()
        stop_s = time.monotonic() + seconds
        while time.monotonic() < stop_s:
            found |= {system.get_system_id() for system in sdk.get_systems() if system.is_connected()}
            time.sleep(0.2)
        print(json.dumps(dict.fromkeys(found, 1)))
    configuration.destroy()


def stop(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(5.0)


def table(fleet: Sequence[int], seen: dict[str, Seen], counts: Iterable[OutputCounts]) -> str:
    lines = ["| program | vehicles seen | of | positions |", "|---|---|---|---|"]
    for program, who in seen.items():
        shown = sum(who.values()) if max(who.values(), default=0) > 1 else "-"
        ids = ", ".join(map(str, sorted(set(who) & set(fleet)))) or "none"
        lines.append(f"| {program} | {ids} | {len(fleet)} | {shown} |")
    lines += ["", "| output | sent | dropped | came back, stopped |", "|---|---|---|---|"]
    lines += [f"| {each.name} | {each.sent} | {each.dropped} | {each.stopped} |" for each in counts]
    return "\n".join(lines)


def compare(seconds: float, ground: int, mavproxy: str | None) -> bool:
    """Runs it; whether all programs saw every vehicle."""
    ours, theirs, sdk = free_port(), free_port(), free_port()
    link = open_link(f"udpin:127.0.0.1:{ours}")
    outs = [f"udpout:127.0.0.1:{port}?ro" for port in ([theirs] if mavproxy else []) + [sdk]]
    fleet, forwarder = SenderFleet(ours, ground), Forwarder(outs)
    seen: dict[str, Seen] = {}
    with tempfile.TemporaryDirectory() as folder:
        proxy = start_mavproxy(mavproxy, theirs, Path(folder)) if mavproxy else None
        client = start_mavsdk(sdk, seconds - 1.0)
        try:
            seen["ours"] = positions(fly(link, forwarder, fleet, seconds))
            answer, _ = client.communicate(timeout=20.0)
        finally:
            client.kill()
            if proxy is not None:
                stop(proxy)
        seen["MAVSDK"] = {int(key): value for key, value in json.loads(answer.splitlines()[-1]).items()}
        if proxy is not None:
            log = Path(folder) / "beside.tlog"
            seen["MAVProxy"] = positions(Tlog.open(log).packets()) if log.exists() else {}
    ids = list(range(1, ground + 2))
    print(table(ids, seen, forwarder.counts))
    back = fleet.received_bytes()
    print(f"\n{back} bytes reached a ground vehicle")
    for each in (link, forwarder, fleet):
        each.close()
    return back == 0 and all(set(ids) <= set(who) for who in seen.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--ground", type=int, default=5)
    parser.add_argument("--mavproxy", default=shutil.which("mavproxy.py"))
    parser.add_argument("--client", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    seconds = min(max(chosen.seconds, 4.0), MOST_SECONDS)
    if chosen.client:
        mavsdk_client(chosen.client, seconds)
        return
    if not chosen.mavproxy:
        print("MAVProxy is not installed and left out: install it somewhere and give --mavproxy …/bin/mavproxy.py\n")
    whole = compare(seconds, chosen.ground, chosen.mavproxy)
    print("all see the whole fleet" if whole else "NOT all see the whole fleet")
    sys.exit(0 if whole else 1)


if __name__ == "__main__":
    main()
