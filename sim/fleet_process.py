"""A simulated fleet in a process of its own: many vehicles, exact counts, and on request all kinds of faults.

    python -m sim.fleet_process --vehicles 100 --rate 5000 --to 127.0.0.1:14550 --duration 60
    python -m sim.fleet_process --to 127.0.0.1:14550 --lie 12:jump --duplicate 13 --replay 14 --flood 1000 --garbage 50

Vehicle 1 flies, vehicles 11 and up drive; each has a source port of its own. At the end one JSON object goes to
standard output: what was sent, by vehicle and by kind of trouble, and how late the latest datagram was.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from infra.processes.end_signals import AskedBySignals, noted_signals
from infra.wall_clock import now_us
from sim.errors import PlayError
from sim.faults.fault_traffic import FaultTraffic, traffic
from sim.faults.fleet_faults import LIES, SimulatedFleet, SimulatedSender

UAV_ID, FIRST_UGV_ID, MAX_VEHICLES = 1, 11, 245
"""System ids of the UAV and of the first ground vehicle; with this many vehicles the last id is 254, as 255 is that of
most ground stations."""
PAUSE_S = 0.002
"""Shortest sleep between datagrams: what is due within it leaves in one bundle."""
LOOK_S = 0.2
"""Longest sleep: whether a signal asks to end is looked at behind it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SendCounts:
    """Counts of what was sent."""

    packets: dict[str, int]
    """Packets by system id, else by name: ``impostor 13``, ``replayed 14``, ``texts``, ``garbage``, ``boot words``."""
    ports: dict[str, int]
    """Source port of each sender at the end."""
    seconds: float
    late_ms: float
    """Lateness of the latest datagram."""
    refused: int
    """Datagrams that the receiver's port refused; not among the packets."""


def system_ids(vehicles: int) -> list[int]:
    """The aircraft's and the ground vehicles' ids."""
    return [UAV_ID, *range(FIRST_UGV_ID, FIRST_UGV_ID + vehicles - 1)]


def send(plan: FaultTraffic, target: tuple[str, int], duration_s: float, asked: AskedBySignals) -> SendCounts:
    """Send until the duration is over or a signal asks to end; what is late is sent at once, nothing is left out."""
    outlets: dict[int, socket.socket] = {}
    packets: Counter[str] = Counter()
    names: dict[int, str] = {}
    refused, late_s = 0, 0.0
    start = time.monotonic()
    try:
        for datagram in traffic(plan, now_us()):
            if datagram.t_s >= duration_s or asked.to_end:
                break
            while (wait_s := start + datagram.t_s - time.monotonic()) > 0.0 and not asked.to_end:
                # in small bundles: waking for each one would cost more than sending it
                time.sleep(min(max(wait_s, PAUSE_S), LOOK_S))
            if not datagram.raw:
                _close(outlets.pop(datagram.outlet, None))
                continue
            late_s = max(late_s, -wait_s)
            outlet = outlets.get(datagram.outlet) or outlets.setdefault(datagram.outlet, _outlet(target))
            names[datagram.outlet] = datagram.label
            try:
                outlet.send(datagram.raw)
                packets[datagram.label] += 1
            except ConnectionRefusedError:
                refused += 1
        ports = {names[number]: outlet.getsockname()[1] for number, outlet in outlets.items()}
    finally:
        for outlet in outlets.values():
            outlet.close()
    seconds = time.monotonic() - start
    return SendCounts(packets=dict(packets), ports=ports, seconds=seconds, late_ms=late_s * 1e3, refused=refused)


def _outlet(target: tuple[str, int]) -> socket.socket:
    outlet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    outlet.connect(target)
    return outlet


def _close(outlet: socket.socket | None) -> None:
    if outlet is not None:
        outlet.close()


def read_keys(path: Path, ids: Sequence[int]) -> dict[int, bytes]:
    """Keys to sign with, 32 bytes by system id.

    Args:
        path: one key for all, or a folder as ``gcs keys`` makes it, ``<system id>.key`` and ``fleet.key`` for the rest;
            32 raw bytes or 64 hexadecimal digits each.

    Raises:
        PlayError: a key is missing or is none.
    """
    if not path.is_dir():
        return dict.fromkeys(ids, _key(path))
    return {i: _key(own if (own := path / f"{i}.key").exists() else path / "fleet.key") for i in ids}


def _key(path: Path) -> bytes:
    try:
        raw = path.read_bytes()
        return raw if len(raw) == 32 else bytes.fromhex(raw.split()[-1].decode())
    except (OSError, ValueError, IndexError) as error:
        raise PlayError(f"{path}: is no key of 32 bytes or 64 hexadecimal digits: {error}") from error


def fleet_of(arguments: argparse.Namespace) -> SimulatedFleet:
    """The senders that the command line asks for."""
    senders = {i: SimulatedSender(system_id=i, place=k) for k, i in enumerate(system_ids(arguments.vehicles))}
    try:
        for system_id, lie in arguments.lie:
            senders[system_id] = replace(senders[system_id], lie=lie)
        for system_id in arguments.v1:
            senders[system_id] = replace(senders[system_id], version=1)
        for system_id in arguments.unsigned:
            senders[system_id] = replace(senders[system_id], signs="never")
        for system_id in arguments.badly_signed:
            senders[system_id] = replace(senders[system_id], signs="wrong")
        for system_id, at_s in arguments.reboot:
            senders[system_id] = replace(senders[system_id], reboot_s=at_s)
        for system_id, at_s in arguments.move_port:
            senders[system_id] = replace(senders[system_id], move_port_s=at_s)
        seconds = [
            replace(
                senders[i],
                place=senders[i].place + len(senders),
                signs="never" if arguments.sign else "right",
                label=f"impostor {i}",
            )
            for i in arguments.duplicate
        ]
    except KeyError as error:
        raise PlayError(f"system id {error} is not in this fleet of {len(senders)}") from error
    return SimulatedFleet(senders=(*senders.values(), *seconds), stop_and_go=arguments.stop_and_go)


def _lie(text: str) -> tuple[int, str]:
    system_id, _, lie = text.partition(":")
    if lie not in LIES:
        raise argparse.ArgumentTypeError(f"{text}: give ID:LIE with one of {', '.join(LIES)}")
    return int(system_id), lie


def _moment(text: str) -> tuple[int, float]:
    system_id, _, at_s = text.partition("@")
    return int(system_id), float(at_s or 10.0)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host or "127.0.0.1", int(port)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sim.fleet_process", description=(__doc__ or "").split("\n")[0])
    add = parser.add_argument
    add("--vehicles", type=int, default=8, help="in all, the aircraft among them")
    add("--rate", type=float, default=400.0, help="packets a second, all vehicles together")
    add("--to", type=_address, required=True, metavar="HOST:PORT")
    add("--duration", type=float, default=30.0, metavar="S")
    add("--sign", type=Path, metavar="KEY", help="key file for all, or a folder with ID.key")
    add("--stop-and-go", action="store_true", help="drive for eight seconds, stop for four")
    add("--banner", action="store_true", help="text before the first packet, as at boot")
    add("--flood", type=float, default=0.0, metavar="HZ", help="hostile texts a second, from the first ground vehicle")
    add("--garbage", type=float, default=0.0, metavar="HZ", help="malformed datagrams a second from an unknown sender")
    add("--lie", type=_lie, action="append", default=[], metavar="ID:LIE", help=f"{', '.join(LIES)}; repeatable")
    ids: dict[str, Any] = {"type": int, "action": "append", "default": [], "metavar": "ID"}
    add("--duplicate", **ids, help="a second sender with this id, elsewhere")
    add("--replay", **ids, help="its frames come again ten seconds late")
    add("--unsigned", **ids, help="does not sign, with --sign")
    add("--badly-signed", **ids, help="signs with a wrong key, with --sign")
    add("--v1", **ids, help="sends MAVLink 1")
    moments: dict[str, Any] = {"type": _moment, "action": "append", "default": [], "metavar": "ID@S"}
    add("--reboot", **moments, help="boots again: silence, boot words, clock from zero, new port")
    add("--move-port", **moments, help="goes on from another source port")
    add("--seed", type=int, default=1)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; 2 for arguments that cannot be used."""
    arguments = _parser().parse_args(argv)
    try:
        if not 1 <= arguments.vehicles <= MAX_VEHICLES:
            raise PlayError(f"--vehicles {arguments.vehicles}: 1 to {MAX_VEHICLES}")
        keys = read_keys(arguments.sign, system_ids(arguments.vehicles)) if arguments.sign else {}
        plan = FaultTraffic(
            fleet=fleet_of(arguments),
            rate_hz=arguments.rate,
            keys=keys,
            flood_hz=arguments.flood,
            garbage_hz=arguments.garbage,
            replayed=frozenset(arguments.replay),
            banner=arguments.banner,
            seed=arguments.seed,
        )
        with noted_signals() as asked:
            sent = send(plan, arguments.to, arguments.duration, asked)
    except (PlayError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    reported = {name: getattr(sent, name) for name in SendCounts.__slots__}
    sys.stdout.write(json.dumps(reported | {"total": sum(sent.packets.values())}) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
