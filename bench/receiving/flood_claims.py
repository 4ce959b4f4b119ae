"""Floods that claim to be a vehicle of the fleet, by its system id, its address or both, against ``gcs fly``.

    python -m bench.receiving.flood_claims --seconds 30 [--only "300 ports"] [--out bench/results/flood_claims.md]

Twenty vehicles send from ports of their own; one of them, system 11, is imitated. The flight is the command that a user
gives; what was recorded is read from its session, and distinguished by the bytes of the frames. It fails where another
vehicle loses a packet, where the imitated one is silent though something tells it from the flood, or where the flood
is reported late or is said to be over before it is.
"""

from __future__ import annotations

import argparse
import os
import random
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from bench.command_line import RESULTS, write_page
from bench.receiving.senders import fleet_frames, send_fleet, send_flood, start_sender
from bench.station import FlyingStation, mission_text
from gcs.session.event_log import read_events
from infra.files.segment import segments
from infra.markdown import markdown_table
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.signing.keys import Key, write_key
from mavlink.signing.signer import Signer
from mavlink.tlog.log import Tlog
from tests.support.ports import free_port

VEHICLES, CLAIMED = 20, 11
RATE = 2400.0
FLOOD = 60_000.0
BEFORE_S, AFTER_S = 3.0, 3.0
"""The fleet sends for this long before and after the flood."""
ALARM_WITHIN_S, EARLY_S = 8.0, 1.5
"""A flood is reported so soon after its process was started, which may take seconds, and is said to be over this much
before its end at the earliest."""
FAIR_SHARE = 0.5
"""A vehicle whose id is flooded from elsewhere keeps at least this share of its packets: it is one of two senders."""
_MESSAGES = 8
_WRONG = bytes(range(100, 132))


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimCase:
    """One attack."""

    name: str
    kinds: tuple[str, ...]
    """Traffic of each of its senders: ``valid`` or ``signed`` frames of the system, frames with a wrong checksum
    (``bad``), or eight bytes of ``junk``."""
    sources: int = 1
    spoofed: bool = False
    """True if the first sends from the vehicle's own address and port."""
    keys: bool = False


CASES = (
    ClaimCase(name="valid frames, 300 ports", kinds=("valid",), sources=300),
    ClaimCase(name="valid frames, one port", kinds=("valid",)),
    ClaimCase(name="valid frames, the vehicle's port", kinds=("valid",), spoofed=True),
    ClaimCase(name="junk from the vehicle's port beside a flood", kinds=("junk", "bad"), spoofed=True),
    ClaimCase(name="bad frames from the vehicle's port", kinds=("bad",), spoofed=True),
    ClaimCase(name="junk from the vehicle's port beside a flood, keys", kinds=("junk", "bad"), spoofed=True, keys=True),
    ClaimCase(name="wrongly signed from the vehicle's port, keys", kinds=("signed",), spoofed=True, keys=True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimResult:
    """Outcome of an attack."""

    sent: Sequence[int]
    """Packets sent, by vehicle."""
    recorded: Sequence[int]
    flooded: int
    of_it: int
    """Records that are none of the fleet's."""
    reported: Sequence[tuple[float, str]]
    """Events of the link with the time since the flood began."""
    flood_s: float
    silent: bool
    """True if a vehicle was said to send no heartbeat during the flood."""


def run(case: ClaimCase, seconds: float, folder: Path) -> ClaimResult:
    """One attack."""
    port, ports = free_port(), [free_port() for _ in range(VEHICLES)]
    secrets = [random.Random(k).randbytes(32) for k in range(VEHICLES)] if case.keys else []
    with ExitStack() as stack:
        session = _fly(stack, folder, port, secrets)
        fleet, counts = start_sender(send_fleet, port, VEHICLES, RATE, seconds, ports=ports, keys=secrets)
        time.sleep(BEFORE_S)
        flood_s = seconds - BEFORE_S - AFTER_S
        floods = []
        for k, kind in enumerate(case.kinds):
            own = ports[CLAIMED - 1] if case.spoofed and k == 0 else 0
            more = {"datagrams": _datagrams(kind), "sources": case.sources, "own": own}
            floods.append(start_sender(send_flood, port, FLOOD / len(case.kinds), flood_s, **more))
        began_us = time.time_ns() // 1000
        sent = counts.recv()
        flooded = sum(of_it.recv() for _, of_it in floods)
        for process in (fleet, *(flood for flood, _ in floods)):
            process.join()
        time.sleep(5.0)
    return _result(session, sent, flooded, began_us, flood_s)


def _datagrams(kind: str) -> list[bytes]:
    speaker, rng = MavlinkEncoder(CLAIMED), random.Random(kind)
    place = (46.6, 8.6, 500.0, 0.0)
    frames = [speaker.global_position_int(k * 7, *place, (3.0, 0.5, 0.0), 0.25) for k in range(_MESSAGES)]
    if kind == "junk":
        return [rng.randbytes(8) for _ in frames]
    if kind == "bad":
        return [frame[:-1] + bytes([frame[-1] ^ 1]) for frame in frames]
    if kind == "signed":
        signer = Signer(Key(_WRONG))
        return [signer.sign(frame, time.time_ns() // 1000) for frame in frames]
    return frames


def _fly(stack: ExitStack, folder: Path, port: int, secrets: Sequence[bytes]) -> Path:
    """Starts a flight; its session."""
    keys = folder / "keys"
    keys.mkdir(mode=0o700)
    for k, secret in enumerate(secrets):
        write_key(keys, k + 1, secret)
    mission = mission_text(range(2, VEHICLES + 1), str(keys) if secrets else "none")
    station = FlyingStation(folder, mission, port)
    stack.callback(station.end)
    time.sleep(2.0)
    return station.session


def _content(raw: bytes) -> bytes:
    """Header from the sequence number on, and payload: the same whether the frame is signed or not."""
    return raw[4 : 10 + raw[1]]


def _result(session: Path, sent: Sequence[int], flooded: int, began_us: int, flood_s: float) -> ClaimResult:
    owner = {_content(frame): k for k in range(VEHICLES) for frame in fleet_frames(k + 1)}
    logs = [Tlog.open(path) for path in segments(session / "telemetry.tlog")]
    counts = Counter(owner.get(_content(packet.raw), -1) for log in logs for packet in log.packets())
    rows, _ = read_events(session / "events.jsonl")
    reported = [((row.t_us - began_us) * 1e-6, row.text) for row in rows if row.kind == "link"]
    silent = any("no heartbeat" in row.text and 0.0 < row.t_us - began_us < 1e6 * flood_s for row in rows)
    return ClaimResult(
        sent=sent,
        recorded=[counts[k] for k in range(VEHICLES)],
        flooded=flooded,
        of_it=counts[-1],
        reported=reported,
        flood_s=flood_s,
        silent=silent,
    )


def faults(case: ClaimCase, r: ClaimResult) -> list[str]:
    """Faults in words; empty where the attack was held."""
    mine, kept = r.sent[CLAIMED - 1], r.recorded[CLAIMED - 1]
    told_s = [at_s for at_s, text in r.reported if "flood" in text]
    over_s = [at_s for at_s, text in r.reported if "is over" in text or "whole again" in text]
    # only junk can be told from the frames of a vehicle whose very address it comes from
    least = mine if "junk" in case.kinds else 0 if case.spoofed else FAIR_SHARE * mine
    found = {
        "others lost": sum(r.recorded) - kept < sum(r.sent) - mine,
        "the imitated one lost": kept < least,
        "false: no heartbeat": r.silent and least > 0,
        "not reported in time": min(told_s, default=r.flood_s) > ALARM_WITHIN_S,
        "said to be over": any(at_s < r.flood_s - EARLY_S for at_s in over_s),
    }
    return [words for words, wrong in found.items() if wrong]


def table(rows: Sequence[tuple[ClaimCase, ClaimResult]]) -> str:
    """The results as Markdown."""
    about = f"{VEHICLES} vehicles, {RATE:,.0f} packets/s, {os.cpu_count()} cores shared by fleet, flood and flight."
    head = ("attack", "flood sent", "of it recorded", "sent by the others", "lost", "sent by the imitated", "lost", "")
    counts = []
    for case, r in rows:
        mine, recorded = r.sent[CLAIMED - 1], r.recorded[CLAIMED - 1]
        others, kept = sum(r.sent) - mine, sum(r.recorded) - recorded
        numbers = (r.flooded, r.of_it, others, others - kept, mine, mine - recorded)
        counts.append([case.name, *(f"{n:,}" for n in numbers), "; ".join(faults(case, r)) or "held"])
    lines = [about, "", markdown_table(head, counts), ""]
    lines += ["What the link reported, in seconds since the flood began:", ""]
    for case, r in rows:
        lines.append(f"- {case.name} ({r.flood_s:.0f} s):")
        lines += [f"  - {at_s:.1f}: {text}" for at_s, text in r.reported]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m bench.receiving.flood_claims", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--only", default="", help="attacks whose name has this")
    parser.add_argument("--out", type=Path, default=RESULTS / "flood_claims.md", help="the table (%(default)s)")
    options = parser.parse_args()
    rows = []
    for case in CASES:
        if options.only in case.name:
            with tempfile.TemporaryDirectory(prefix="flood-") as folder:
                rows.append((case, run(case, options.seconds, Path(folder))))
            print(table(rows[-1:]), flush=True)
    write_page(options.out, table(rows))
    return int(any(faults(case, r) for case, r in rows))


if __name__ == "__main__":
    raise SystemExit(main())
