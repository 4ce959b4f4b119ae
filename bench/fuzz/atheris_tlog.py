"""Logs through the index and the check."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bench.fuzz.guided import guided


def make() -> Callable[[bytes], None]:
    import numpy as np

    from mavlink.tlog.check import check
    from mavlink.tlog.index import build_index
    from mavlink.tlog.log import Tlog

    def one(data: bytes) -> None:
        if not data:
            return
        array = np.frombuffer(data, dtype=np.uint8)
        log = Tlog(Path("made"), array, build_index(array))
        found = check(log)
        assert len(list(log.packets())) == found.records
        ends = log.index.offset + log.index.length
        assert bool((log.index.offset[1:] >= ends[:-1]).all())
        assert all(0 <= d.start < d.stop <= len(data) for d in found.damage)

    return one


if __name__ == "__main__":
    guided(make, ["mavlink"])
