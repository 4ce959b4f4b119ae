"""Checks of what this machine brings to a flight, and what to do where it falls short. Each check has what it found."""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import av
import onnxruntime as ort

from gcs.health.detector_speed import FRAME_SIZE, HEIGHTS_M, USUAL_M, ground_sampling, seconds_a_frame
from gcs.health.preflight import Check, Verdict
from gcs.health.station_alarms import FULL_BYTES, LOW_BYTES
from mavlink.errors import LinkError
from mavlink.links.kinds import open_link
from mavlink.links.udp import MIN_BUFFER_BYTES
from vision.detect.detector import Detector, open_detector
from vision.detect.turns import in_turns

PACKAGES = ("pymavlink", "mavsdk", "numpy", "scipy", "opencv-python-headless", "onnxruntime", "av", "textual")
DECODERS, ENCODERS = ("h264", "hevc", "mjpeg"), ("libx264",)
PORTS = (14550, 14551)
"""Ports that ground stations listen on by custom, and that this one forwards to in the examples."""
SLOW_FPS, LIVE_FPS = 5.0, 15.0
"""Frames a second: below the first, names come late; from the second on most cameras are kept up with."""
MIN_FPS = 2.0
"""Looks a second at a camera that is not on show."""
CAMERA_DELAY = "not measured here, see docs/operations.md; a flight shows its estimate from 0.1 s on"
_TIME_ERROR = 5
"""Answer of adjtimex(2) while the clock is not synchronised."""
_TIMEX_BYTES = 512
"""Size of a buffer, larger than struct timex on any architecture; its first field, 0, asks without setting."""


def checks(
    sessions: Path,
    ports: Sequence[int] = PORTS,
    *,
    gsd_m: float | None = None,
    open_detector: Callable[[], Detector] | None = None,
    cameras: int = 1,
) -> Iterator[Check]:
    """Look at everything but the terminal; takes some three seconds, for the detector is measured.

    Args:
        sessions: where flights are recorded; it need not exist yet.
        gsd_m: ground metres a pixel at the planned height; None: those of a usual lens at several.
        open_detector: loads the mission's networks; None: the bundled one.
        cameras: that are to be flown at once.
    """
    yield _versions()
    yield _system()
    yield from _detector(gsd_m, open_detector, cameras)
    yield _codecs("video decoders", DECODERS, "r")
    yield _codecs("video encoders", ENCODERS, "w")
    for port in ports:
        yield _port(port)
    yield _receive_buffer()
    yield _disk(sessions)
    yield _clock()
    yield Check(name="camera delay", verdict="ok", found=CAMERA_DELAY)


def _versions() -> Check:
    found = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return Check(
        name="versions",
        verdict="ok",
        found=f"rollcall-gcs {version('rollcall-gcs')}, Python {platform.python_version()}, {found}",
    )


def _system() -> Check:
    text = f"{platform.system()} {platform.release()} on {platform.machine()}, {os.cpu_count()} processors"
    if sys.platform.startswith("linux"):
        return Check(name="system", verdict="ok", found=text)
    return Check(
        name="system",
        verdict="short",
        found=text,
        advice="flights need Linux (WSL2 counts); recordings can be replayed and identified here",
    )


def _detector(gsd_m: float | None, opened: Callable[[], Detector] | None, cameras: int) -> Iterator[Check]:
    providers = ort.get_available_providers()
    yield Check(name="detector providers", verdict="ok", found=", ".join(providers))
    detector = opened() if opened else open_detector(threads=os.cpu_count() or 1)
    scales = {"": gsd_m} if gsd_m else {f" {height_m:g} m up": ground_sampling(height_m) for height_m in HEIGHTS_M}
    rates = {where: 1.0 / seconds_a_frame(detector, scale) for where, scale in scales.items()}
    found = ", ".join(
        f"{rates[where]:.1f} frames/s{where}{' in turns' * in_turns(detector, FRAME_SIZE, scale)}"
        f" ({scale * 100:.1f} cm a pixel)"
        for where, scale in scales.items()
    )
    fps = rates["" if gsd_m else f" {USUAL_M:g} m up"]
    which = "the mission's" if opened else "the bundled"
    advice = "" if fps >= LIVE_FPS else "close other programs, or choose a smaller stream"
    yield Check(
        name="detector speed",
        verdict="short" if advice else "ok",
        advice=advice + ("; names will be late" if fps < SLOW_FPS else ""),
        found=f"{found} at {FRAME_SIZE[0]}×{FRAME_SIZE[1]}, with {which} detector",
    )
    yield carried(fps, cameras)


def carried(fps: float, cameras: int) -> Check:
    """Count of cameras that a detector of that speed looks at in time.

    Args:
        fps: frames that it looks at in a second.
        cameras: that are to be flown at once.
    """
    most = 1 + max(int((fps - SLOW_FPS) / MIN_FPS), 0)
    few = f"{cameras} are to be flown: the others are looked at too rarely; leave some out, or choose a smaller model"
    return Check(
        name="cameras",
        verdict="short" if most < cameras else "ok",
        found=f"{most} at once by the detector's speed: {SLOW_FPS:g} looks/s at the one on show, {MIN_FPS:g} at each "
        "other one",
        advice=few if most < cameras else "",
    )


def _codecs(name: str, wanted: Sequence[str], mode: Literal["r", "w"]) -> Check:
    missing = [codec for codec in wanted if not _has(codec, mode)]
    if not missing:
        return Check(name=name, verdict="ok", found=", ".join(wanted))
    return Check(
        name=name,
        verdict="bad",
        found=f"missing: {', '.join(missing)}",
        advice="install PyAV as a wheel, which brings FFmpeg with them",
    )


def _has(codec: str, mode: Literal["r", "w"]) -> bool:
    try:
        av.codec.Codec(codec, mode)
    except ValueError:  # UnknownCodecError is one
        return False
    return True


def _port(port: int) -> Check:
    try:
        open_link(str(port)).close()
    except LinkError as error:
        return Check(
            name=f"UDP port {port}", verdict="short", found=str(error), advice="stop that program, or use another port"
        )
    return Check(name=f"UDP port {port}", verdict="ok", found="free")


def _receive_buffer() -> Check:
    limit = Path("/proc/sys/net/core/rmem_max")
    try:
        most = int(limit.read_text())
    except (OSError, ValueError):
        return Check(name="receive buffer", verdict="ok", found="the system does not report its limit")
    if most >= MIN_BUFFER_BYTES or os.geteuid() == 0:
        return Check(name="receive buffer", verdict="ok", found=f"{most / 2**20:.1f} MiB allowed to programs")
    return Check(
        name="receive buffer",
        verdict="short",
        found=f"{most / 2**20:.1f} MiB allowed: a pause of the machine can cost packets",
        advice=f"sudo sysctl net.core.rmem_max={MIN_BUFFER_BYTES}",
    )


def _disk(sessions: Path) -> Check:
    place = next((p for p in (sessions, *sessions.absolute().parents) if p.is_dir()), Path("/"))
    free = shutil.disk_usage(place).free
    found = f"{free / 1e9:.1f} GB free for {sessions}"
    if not os.access(place, os.W_OK):
        return Check(
            name="disk", verdict="bad", found=f"{place} cannot be written", advice="choose another folder for sessions"
        )
    if free >= LOW_BYTES:
        return Check(name="disk", verdict="ok", found=found)
    verdict: Verdict = "short" if free >= FULL_BYTES else "bad"
    return Check(
        name="disk", verdict=verdict, found=found, advice="free space; an hour with 8 Mbit/s video takes 3.6 GB"
    )


def _clock() -> Check:
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        state = -1
    if state == _TIME_ERROR:
        return Check(
            name="clock",
            verdict="short",
            found="not synchronised",
            advice="timedatectl set-ntp true, or set it from a GPS: signatures and GPS times are compared with it",
        )
    if state < 0:
        return Check(name="clock", verdict="ok", found="the system does not report whether it is synchronised")
    return Check(name="clock", verdict="ok", found="synchronised")
