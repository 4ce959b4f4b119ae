"""Mission files through the loader."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from bench.fuzz.guided import guided


def make() -> Callable[[bytes], None]:
    from bench.fuzz.missions import MissionScore, read_mission

    path = Path(tempfile.mkdtemp()) / "mission.toml"

    def one(data: bytes) -> None:
        path.write_bytes(data)
        score = MissionScore()
        read_mission(path, score)
        assert not score.failures, score.failures

    return one


if __name__ == "__main__":
    guided(make, ["gcs.mission.mission"])
