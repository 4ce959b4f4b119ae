"""Cost of checking a signature, in one run on one core.

    python bench/receiving/signing_speed.py --frames 200000

A hundred vehicles with a key each and 4,096 streams. pymavlink's own check, of one stream with one key, is beside.
"""

from __future__ import annotations

import argparse
import hashlib
import struct
import time
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.signing.keys import Key, KeyRing
from mavlink.signing.signer import Signer
from mavlink.signing.streams import ticks_of
from mavlink.signing.verifier import Verifier

T0 = 1_790_000_000_000_000
VEHICLES, STREAMS = 100, 4096


def secret(system_id: int) -> bytes:
    return hashlib.sha256(struct.pack("<I", system_id)).digest()


def ring() -> KeyRing:
    return KeyRing(keys={system_id: Key(secret(system_id)) for system_id in range(1, VEHICLES + 1)})


def frames(count: int) -> tuple[list[Packet], list[Packet], list[Packet]]:
    """Signed, unsigned and forged packets of the same frames, over all streams in turn."""
    keys = ring().keys
    streams = [(1 + k % VEHICLES, 1 + k // VEHICLES % 16, k // (VEHICLES * 16)) for k in range(STREAMS)]
    plain = {(s, c): MavlinkEncoder(s, c).attitude(5, 0.1, 0.2, 0.3, (0.0, 0.0, 0.4)) for s, c, _ in streams}
    signers = {system_id: Signer(key) for system_id, key in keys.items()}
    unsigned, signed, forged = [], [], []
    for k in range(count):
        stream = streams[k % STREAMS]
        t_us, frame = T0 + k * 10, plain[stream[:2]]
        raw = signers[stream[0]].sign(frame, t_us, stream[2])
        unsigned.append(Packet(t_us, frame))
        signed.append(Packet(t_us, raw))
        forged.append(Packet(t_us, raw[:-1] + bytes([raw[-1] ^ 1])))
    return signed, unsigned, forged


def cost_us(check: Callable[[Packet], Auth], packets: Sequence[Packet], wanted: Auth) -> float:
    """Mean CPU time of a call, µs, less that of an empty loop."""
    start = time.process_time()
    for packet in packets:
        if check(packet) is not wanted:
            raise SystemExit(f"a frame is not {wanted.name}")
    spent = time.process_time() - start
    start = time.process_time()
    for packet in packets:
        if packet is None:
            raise SystemExit
    return (spent - (time.process_time() - start)) / len(packets) * 1e6


def pymavlink_us(count: int) -> float:
    sender = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    receiver = ardupilotmega.MAVLink(None)
    for side in (sender, receiver):
        side.signing.secret_key = secret(1)
        side.signing.timestamp = ticks_of(T0)
    sender.signing.sign_outgoing = True
    message = ardupilotmega.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.4)
    raws = [bytearray(message.pack(sender)) for _ in range(count)]
    start = time.process_time()
    for raw in raws:
        if not receiver.check_signature(raw, 1, 1):
            raise SystemExit("pymavlink refuses its own frame")
    return (time.process_time() - start) / count * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=200_000)
    options = parser.parse_args()
    signed, unsigned, forged = frames(options.frames)
    checker = Verifier(ring())
    rows = [
        ("good", cost_us(checker.check, signed, Auth.GOOD)),
        ("replayed", cost_us(checker.check, signed, Auth.REPLAYED)),
        ("forged: bad signature", cost_us(checker.check, forged, Auth.BAD)),
        ("unsigned, refused", cost_us(checker.check, unsigned, Auth.UNSIGNED)),
        ("no keys at all", cost_us(Verifier(KeyRing()).check, signed, Auth.OPEN)),
        ("pymavlink's check_signature, good", pymavlink_us(options.frames)),
    ]
    print(f"{options.frames} frames, {VEHICLES} keys, {len(checker.streams)} streams; CPU time of a call")
    for name, cost in rows:
        print(f"{name:<36}{cost:>6.2f} µs")


if __name__ == "__main__":
    main()
