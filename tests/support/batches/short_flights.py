"""Short flights for batches, cut from the bundled swarm with what was detected in it, and flights that are broken."""

from __future__ import annotations

import re
from pathlib import Path

from tests.support.bundled import SWARM, shortened


def short_flights(folder: Path, count: int, frames: int = 12) -> list[Path]:
    """So many flights ``a``, ``b``, …, each a frame longer than the one before."""
    folder.mkdir(parents=True, exist_ok=True)
    return [shortened(SWARM, folder / chr(ord("a") + k), frames + k) for k in range(count)]


def broken_flights(folder: Path) -> dict[str, Path]:
    """One of each kind of flight that cannot be named, by what is wrong with it."""
    made = {kind: shortened(SWARM, folder / f"broken {kind}", 12) for kind in ("mission", "log", "frames", "boxes")}
    toml = made["mission"] / "session.toml"
    toml.write_text(re.sub(r"(?m)^system_id = .*$", 'system_id = "<b>one</b>"', toml.read_text()))
    (made["log"] / "telemetry.tlog").write_bytes(b"no log" * 100)
    (made["frames"] / "frames.csv").unlink()
    (made["boxes"] / "detections.csv").write_text("nothing,of,this\n1,2,3\n")
    (folder / "broken empty").mkdir()
    return {**made, "empty": folder / "broken empty", "gone": folder / "gone"}
