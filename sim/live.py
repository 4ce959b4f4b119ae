"""Plays a scenario in real time: telemetry over UDP, a socket per vehicle, and the cameras' video as MPEG-TS."""

from __future__ import annotations

import dataclasses
import re
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from infra.wall_clock import now_us
from sim.errors import PlayError
from sim.practice import MIRROR, VIDEO, Troubles
from sim.render.broadcast import VideoSender
from sim.telemetry.messages import camera
from sim.telemetry.vehicle_telemetry import TELEMETRY_FROM_S, TelemetryPacket, fleet_telemetry
from sim.world.scenario import UAV_ID, Scenario
from sim.world.world import World

TICK_S = 0.2
"""Interval of ``on_tick``, and longest time until ``stop`` is noticed."""
LEAD_S, LEAD_PER_VEHICLE_SECOND = 0.3, 1e-4
"""Time before the first packet is due, and more per vehicle and second of flight: readings are computed in advance."""

CAMERA_US = 1_000_000
"""Interval between two reports of the camera."""

BOOT_NOISE = (b"\n\nInit ArduRover V4.6.0\n\nFree RAM: 131072\n", b"Init Gyro", b"*", b"0 ")
"""Plain text of an autopilot's boot console, which receivers must skip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaybackCounts:
    """Counts of what was sent."""

    packets: dict[int, int]
    """MAVLink packets by system id."""
    frames: int
    """Video frames, of all cameras together."""
    frames_skipped: int
    """Frames that were due before they could be drawn."""
    start_us: int
    """Unix time of the first frame's exposure."""


def play(
    scenario: Scenario,
    telemetry_url: str = "udpout:127.0.0.1:14550",
    video_url: str | None = "udp://127.0.0.1:5600",
    duration_s: float | None = None,
    on_tick: Callable[[float], None] | None = None,
    *,
    stop: threading.Event | None = None,
    boot_noise: bool = False,
    truth_path: Path | None = None,
    tells_camera: bool = False,
    practise_port: int = 0,
    keys: Mapping[int, bytes] | None = None,
) -> PlaybackCounts:
    """Play a scenario until its duration is over or ``stop`` is set.

    Telemetry begins two seconds before the video. Each vehicle has a socket, hence a source port, of its own. Frames
    are exposed on time or skipped, never queued; their time stamps are their true exposure times.

    Args:
        scenario: what is flown; its ``start_us`` is replaced by the present.
        telemetry_url: ``udpout:host:port``.
        video_url: ``udp://host:port``, or None for telemetry alone; a second camera's video goes to the next port.
        duration_s: length of the video; the scenario's own when None.
        on_tick: called about five times a second with the seconds since the first frame (negative before it).
        stop: ends it early when set.
        boot_noise: begin with the plain text that autopilots send while they boot.
        tells_camera: the UAV's camera reports its field of view and its video once a second.
        practise_port: of this computer, at which datagrams begin and end troubles (``sim.practice``); 0: none.
        keys: 32 bytes that each vehicle signs with, by system id.
        truth_path: a new file for ``time_us,cx,cy,w,h,angle,system_id`` of every visible body in every sent frame; what
            a second camera shows goes to ``truth-2.csv`` beside a ``truth.csv``.

    Raises:
        PlayError: if an address is malformed or the truth file exists.
        ScenarioError: if the scenario cannot be simulated.
    """
    target = _udp_target(telemetry_url)
    stop = stop or threading.Event()
    scenario = dataclasses.replace(scenario, duration_s=duration_s or scenario.duration_s)
    world = World(scenario)
    views = world.views
    urls = [_nth_url(video_url, k) if video_url else None for k in range(len(views) + 1)]
    senders = {
        UAV_ID + k: VideoSender(each, url, _nth_path(truth_path, k))
        for k, (each, url) in enumerate(zip((world, *views), urls, strict=True))
        if url
    }
    lead_s = LEAD_S + LEAD_PER_VEHICLE_SECOND * (scenario.fleet_size + len(views)) * scenario.duration_s
    start_us = now_us() + round((lead_s - TELEMETRY_FROM_S) * 1e6)
    uavs = range(UAV_ID, UAV_ID + len(views) + 1)
    masts = [uav for uav, view in zip(uavs[1:], scenario.views, strict=True) if view.mast]
    packets = dict.fromkeys((i for i in (*uavs, *scenario.ugv_ids) if i not in masts), 0)
    cameras = {
        i: _camera_frames(each.scenario, url, i)
        for each, url, i in zip((world, *views), urls, uavs, strict=True)
        if i not in masts
    }
    camera_due_us = 0
    troubles = Troubles(tuple(packets), practise_port, keys)
    with ExitStack() as stack:
        stack.callback(troubles.close)
        impostor = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sockets = {i: stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for i in packets}
        for sender in senders.values():
            sender.start(start_us)
            stack.callback(sender.close)
        for noise in BOOT_NOISE if boot_noise else ():
            for outlet in sockets.values():
                outlet.sendto(noise, target)
        for packet in _on_time(_with_farewell(fleet_telemetry(world, start_us, views)), start_us, stop, on_tick):
            troubles.listen()
            for system_id, sender in senders.items():
                sender.lost, sender.mirrored = (troubles.has(name, system_id) for name in (VIDEO, MIRROR))
            for forged, raw in troubles.frames(packet.raw):
                (impostor if forged else sockets[packet.system_id]).sendto(raw, target)
                packets[packet.system_id] += not forged
            if tells_camera and packet.t_us >= camera_due_us:
                camera_due_us = packet.t_us + CAMERA_US
                for system_id, stream in cameras.items():
                    for _, frame in chain.from_iterable(map(troubles.frames, next(stream))):
                        sockets[system_id].sendto(frame, target)
    return PlaybackCounts(
        packets=packets,
        frames=sum(sender.sent for sender in senders.values()),
        frames_skipped=sum(sender.skipped for sender in senders.values()),
        start_us=start_us,
    )


def _with_farewell(packets: Iterable[TelemetryPacket]) -> Iterator[TelemetryPacket]:
    """Add the UAV's announcement of the end: a station could not tell it from radios that were lost."""
    mav, t_us = dialect.MAVLink(None, srcSystem=UAV_ID, srcComponent=dialect.MAV_COMP_ID_AUTOPILOT1), 0
    for packet in packets:
        t_us = packet.t_us
        yield packet
    farewell = dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_WARNING, b"The simulated flight is over")
    yield TelemetryPacket(t_us=t_us, raw=bytes(farewell.pack(mav)), vehicle=-1)


def _nth_url(url: str, k: int) -> str:
    """The same address, this many ports further on."""
    return re.sub(r":(\d+)(?=$|\?)", lambda port: f":{int(port[1]) + k}", url)


def _nth_path(path: Path | None, k: int) -> Path | None:
    return path.with_stem(f"{path.stem}-{k + 1}") if path and k else path


def _camera_frames(scenario: Scenario, video_url: str | None, uav_id: int = UAV_ID) -> Iterator[tuple[bytes, ...]]:
    """Messages that the camera sends time and again; a component of its aircraft's system."""
    port = re.search(r":(\d+)", (video_url or "").partition("://")[2])
    messages = camera(scenario, int(port[1]) if port else 0)
    mav = dialect.MAVLink(None, srcSystem=uav_id, srcComponent=dialect.MAV_COMP_ID_CAMERA)
    while True:
        frames = []
        for message in messages:
            frames.append(bytes(message.pack(mav)))
            mav.seq = (mav.seq + 1) % 256
        yield tuple(frames)


def _on_time(
    packets: Iterable[TelemetryPacket], start_us: int, stop: threading.Event, on_tick: Callable[[float], None] | None
) -> Iterator[TelemetryPacket]:
    """Yield each packet at its time of arrival; ends when ``stop`` is set."""
    next_tick = -np.inf
    for packet in packets:
        while (wait_s := packet.t_us / 1e6 - time.time()) > 0.0:
            now = time.time() - start_us / 1e6
            if on_tick is not None and now >= next_tick:
                on_tick(now)
                next_tick = now + TICK_S
            if stop.wait(min(wait_s, TICK_S)):
                return
        if stop.is_set():
            return
        yield packet


def _udp_target(url: str) -> tuple[str, int]:
    scheme, _, address = url.partition(":")
    host, _, port = address.removeprefix("//").rpartition(":")
    if scheme != "udpout" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise PlayError(f"{url}: is no telemetry address; give udpout:host:port, for example udpout:127.0.0.1:14550")
    return host, int(port)
