"""Datagrams through split, decode, the fleet's state and the parser of streams."""

from __future__ import annotations

from collections.abc import Callable

from bench.fuzz.guided import guided


def make() -> Callable[[bytes], None]:
    from bench.fuzz.datagrams import Listener
    from mavlink.protocol.dialect import DEFINITIONS
    from mavlink.protocol.framing import Framer, checksum, split

    ids = sorted(DEFINITIONS)

    def right(data: bytes) -> bytes:
        """The input as contents of a frame with a right checksum: sender, message, payload."""
        message_id = ids[int.from_bytes(data[:2], "little") % len(ids)]
        longest, extra = DEFINITIONS[message_id]
        payload = data[3 : 3 + longest]
        sender = bytes([0, data[2] % 8, 1]) + message_id.to_bytes(3, "little")
        frame = bytes([0xFD, len(payload), 0, 0]) + sender + payload
        return frame + checksum(frame, extra).to_bytes(2, "little")

    def one(data: bytes) -> None:
        listener = Listener()
        listener.receive(data)
        if len(data) > 3:
            listener.receive(right(data))
        listener.fleet.at(listener.t_us)
        frames, counts = split(data)
        assert sum(map(len, frames)) + counts.junk_bytes == len(data)
        framer, half = Framer(), len(data) // 2
        streamed = framer.receive_bytes(data[:half]) + framer.receive_bytes(data[half:]) + framer.finish()
        assert sum(map(len, streamed)) + framer.counts.junk_bytes == len(data)

    return one


if __name__ == "__main__":
    guided(make, ["mavlink"])
