"""Absurd mission files: each is accepted or refused with one line."""

from __future__ import annotations

import random
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from gcs.errors import ConfigError
from gcs.mission.mission import load_mission

GOOD = """\
[uav]
system_id = 1
name = "copter"

[[ugv]]
system_id = 11

[[ugv]]
system_id = 12
name = "cart"

[camera]
width = 1280
height = 720
fx = 1000.0
fy = 1000.0
cx = 640.0
cy = 360.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
mount = "fixed"
pitch_deg = -90.0

[clock]
video_offset_s = "auto"

[detector]
score = 0.3
classes = ["car"]

[identity]
threshold = 0.7

[links]
telemetry = ["udpin:127.0.0.1:14550"]
video = "udp://127.0.0.1:5600"
"""
_KEYS = (
    "uav",
    "ugv",
    "camera",
    "clock",
    "detector",
    "identity",
    "links",
    "session",
    "system_id",
    "name",
    "width",
    "height",
    "fx",
    "fy",
    "cx",
    "cy",
    "distortion",
    "lens",
    "zoom",
    "zoom_max",
    "device",
    "gimbal",
    "mount",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "video_offset_s",
    "model",
    "score",
    "classes",
    "imgsz",
    "tiled",
    "providers",
    "front",
    "front_sure",
    "threshold",
    "telemetry",
    "video",
    "keys",
    "origin",
    "x",
    "",
)
_VALUES: tuple[Any, ...] = (
    0, 1, -1, 255, 256, 2**53, 2**63, -(2**63), 10**400, 0.5, -0.0, 1e308, float("nan"), float("inf"), float("-inf"),
    True, False, "", "auto", "fixed", "../..", "/", "a\0b", "\u202e[/]\x1b[31m", "x" * 3000, [], {}, [[]], [{}],
    [0, 0, 0, 0, 0], [1e308] * 5, ["car", 1], {"system_id": 1}, [{"system_id": 1}],
)  # fmt: skip


@dataclass(slots=True)
class MissionScore:
    """Sums over files."""

    files: int = 0
    accepted: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)


def draw_text(rng: random.Random) -> bytes:
    """The text of a good mission with bytes, lines and signs changed."""
    data = bytearray(GOOD.encode())
    for _ in range(rng.randrange(1, 6)):
        at = rng.randrange(len(data))
        kind = rng.randrange(4)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            del data[at : at + rng.randrange(1, 20)]
        elif kind == 2:
            data[at:at] = rng.choice(
                (b"[", b"]]", b'"', b"\n", b"=", b"nan", b"1e999", b"\xff", b"\0", b"{", b"1979-05-27")
            )
        else:
            lines = bytes(data).splitlines(keepends=True)
            rng.shuffle(lines)
            data = bytearray(b"".join(lines))
        data = data or bytearray(b"\n")
    return bytes(data)


def _value(rng: random.Random, depth: int) -> Any:  # noqa: ANN401  (any value of TOML)
    if depth and rng.random() < 0.2:
        return {rng.choice(_KEYS): _value(rng, depth - 1) for _ in range(rng.randrange(4))}
    if depth and rng.random() < 0.2:
        return [_value(rng, depth - 1) for _ in range(rng.randrange(4))]
    return rng.choice(_VALUES)


def draw_table(rng: random.Random, good: dict[str, Any]) -> dict[str, Any]:
    """A good mission's tables with values, keys and kinds changed."""
    table = {key: dict(value) if isinstance(value, dict) else value for key, value in good.items()}
    for _ in range(rng.randrange(1, 4)):
        inner = [value for value in table.values() if isinstance(value, dict)]
        target = rng.choice([table, *inner])
        if target and rng.random() < 0.6:
            target[rng.choice(list(target))] = _value(rng, 3)
        else:
            target[rng.choice(_KEYS)] = _value(rng, 3)
    return table


def read_mission(path: Path, score: MissionScore) -> None:
    """Load one file; a refusal must be one line that names the file."""
    score.files += 1
    try:
        load_mission(path)
        score.accepted += 1
    except ConfigError as error:
        score.refused += 1
        if str(path) not in str(error):
            score.failures.append(f"the file is not named: {error}")
    except Exception as error:  # noqa: BLE001  (that there is no other is what is being measured)
        score.failures.append(f"{error!r} from {path.read_bytes()!r}")


def fuzz_missions(seeds: range, good: dict[str, Any]) -> MissionScore:
    """Files of both kinds, by turns."""
    score = MissionScore()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.toml"
        for seed in seeds:
            rng = random.Random(seed)
            try:
                data = draw_text(rng) if seed % 2 else tomli_w.dumps(draw_table(rng, good)).encode()
            except (ValueError, TypeError, UnicodeEncodeError):
                continue  # no value of TOML
            path.write_bytes(data)
            read_mission(path, score)
    return score
