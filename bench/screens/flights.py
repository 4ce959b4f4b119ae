"""Scripted flights in simulated time: what a screen would poll, with what was really received beside it.

Fleet, fold, tracker, identifier, alarms and frame loop are the flight's own; the world, its telemetry and its detector
are the simulator's. Every hiccup, hole and restart occurs at an exact time.
"""

from __future__ import annotations

import heapq
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.flight.frame_loop import FrameLoop
from gcs.fold.pipeline import Pipeline
from gcs.health.faults import Faults
from gcs.mission.mission import Mission, parse_mission
from gcs.session.recorder import Recorder
from gcs.snapshot import Event, Health, LinkHealth, Snapshot
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from sim.render.film import Film
from sim.telemetry.detections import DetectorModel
from sim.telemetry.vehicle_telemetry import TELEMETRY_FROM_S, fleet_telemetry
from sim.world.scenario import UAV_ID, Scenario, ScenarioFault, ScenarioGround
from sim.world.world import World
from tests.support.scripted import CAMERA, IMPOSTOR_PEER, RebootedEncoder, ScriptedDetector, boxes_of, impostor_frames
from vision.detect.detections import Detections
from vision.stream.pace import PACE_FRAMES, stall_after_s
from vision.video.video import Frame

S = 1_000_000
Span = tuple[float, float]
"""From when to when, seconds since the first frame."""
NEVER_US = 0
TURN_US = 20_000
"""The loop looks so often whether a frame came."""
IDLE_US = 200_000
"""After this time without a frame the fold runs on telemetry alone, as in a flight."""
POLL_US = 83_333
"""The screen polls twelve times a second."""
MONITOR_US = 500_000
HEARTBEAT, GLOBAL_POSITION_INT = 0, 33
REBOOTED_PEERS = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Script:
    """What happens in one flight."""

    name: str
    seconds: float = 16.0
    fps: float = 15.0
    latency_s: float = 0.06
    """From a frame's exposure until it is here."""
    vehicles: int = 6
    names: Mapping[int, str] = field(default_factory=dict)
    """Of ground vehicles, by system id; ``UGV-<id>`` for the rest."""
    no_frames: tuple[Span, ...] = ()
    silent: Mapping[int, Span] = field(default_factory=dict)
    """When nothing of a vehicle is received, by system id; 0: of no vehicle."""
    restarted: tuple[int, ...] = ()
    """Of the silent ones, those that were switched off: their clocks begin again."""
    impostor: Span | None = None
    """A second sender uses the first ground vehicle's id."""
    texts: Span | None = None
    """The last ground vehicle sends texts without end, some of which look like alarms of this station."""
    texts_hz: float = 40.0
    events: Span | None = None
    """Links report without end."""
    disk_fails: Span | None = None
    faults: tuple[ScenarioFault, ...] = ()
    ground: str = "curved"
    poll_us: int = POLL_US
    filmed: bool = False
    """Frames are rendered, else all alike: names need no picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """When something of a vehicle was received last, Unix µs, 0 never."""

    heartbeat_us: int = NEVER_US
    position_us: int = NEVER_US


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """What a screen is given at one poll, and what is really so."""

    now_us: int
    snapshot: Snapshot
    events: tuple[Event, ...]
    received: Mapping[int, Received]
    """By system id; none of a vehicle whose id somebody else uses too."""
    frame_us: int
    """When the newest frame was taken, 0 before the first."""
    named: Mapping[int, str]
    """Standing of each ground vehicle at the newest frame, by system id."""


@dataclass(frozen=True, slots=True, order=True)
class _ScriptedPacket:
    t_us: int
    number: int
    peer: int
    raw: bytes


def fly(script: Script) -> Iterator[Moment]:
    """The moments of a flight at which its screen polls."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _ScreenedFlight(script, Path(folder)).moments()


class _ScreenedFlight:
    """One flight in simulated time."""

    def __init__(self, script: Script, folder: Path) -> None:
        self.script, self.scenario = script, _scenario(script)
        self.world = World(self.scenario)
        self.start_us = self.scenario.start_us
        self.now_us = self.start_us + round(TELEMETRY_FROM_S * S)
        self.mission = _mission(script, self.scenario)
        self.detector = ScriptedDetector()
        self.recorder = Recorder(folder, self.mission, video=False)
        self.loop = FrameLoop(
            Pipeline(self.mission, ("udpin:0.0.0.0:14550", "/dev/ttyUSB0")),
            self.detector,
            self.recorder,
            Faults(folder / "faults.txt"),
            self._keep_names,
            now_us=lambda: self.now_us,
        )
        self.received: dict[int, Received] = {}
        self.named: dict[int, str] = {}
        self.frames_us: list[int] = []
        self.packets = 0
        self.packet_us = self.frame_us = 0

    def moments(self) -> Iterator[Moment]:
        datagrams, frames = _datagrams(self.script, self.world), _frames(self.script, self.world)
        datagram, frame = next(datagrams, None), next(frames, None)
        stop_us = self.start_us + round(self.script.seconds * S)
        turn_us = poll_us = monitor_us = self.now_us
        while self.now_us < stop_us:
            self.now_us += TURN_US
            arrived = []
            while datagram is not None and datagram.t_us <= self.now_us:
                arrived.append(self._packet(datagram))
                datagram = next(datagrams, None)
            self.loop.add_packets(arrived, self.now_us)
            newest: Frame | None = None
            while frame is not None and frame[0] <= self.now_us:
                _, newest, self.detector.boxes = frame
                frame = next(frames, None)
            if self.now_us >= monitor_us:
                monitor_us += MONITOR_US
                self._monitor()
            if newest is not None or self.now_us - turn_us >= IDLE_US:
                turn_us = self.now_us
                if newest is not None:
                    self.frame_us = newest.t_us
                    self.frames_us.append(newest.t_us)
                self.loop.run_once(newest)
            if self.now_us >= poll_us and self.loop.latest is not None:
                poll_us += self.script.poll_us
                yield self._moment(self.loop.latest)
        self.recorder.close()

    def _moment(self, snapshot: Snapshot) -> Moment:
        return Moment(
            now_us=self.now_us,
            snapshot=snapshot,
            events=tuple(self.loop.events()),
            received=dict(self.received),
            frame_us=self.frame_us,
            named=dict(self.named),
        )

    def _packet(self, datagram: _ScriptedPacket) -> Packet:
        self.packets += 1
        self.packet_us = datagram.t_us
        packet = Packet(datagram.t_us, datagram.raw, 0, datagram.peer)
        before = self.received.get(packet.system_id, Received())
        if datagram.peer == IMPOSTOR_PEER:
            return packet
        if packet.message_id == HEARTBEAT:
            before = replace(before, heartbeat_us=datagram.t_us)
        elif packet.message_id == GLOBAL_POSITION_INT:
            before = replace(before, position_us=datagram.t_us)
        self.received[packet.system_id] = before
        return packet

    def _keep_names(self, snapshot: Snapshot) -> None:
        self.named = {row.system_id: row.standing for row in snapshot.vehicles if row.role == "ugv"}

    def _monitor(self) -> None:
        script, at_s = self.script, (self.now_us - self.start_us) / S
        silent_s = (self.now_us - self.packet_us) / S if self.packet_us else float("inf")
        video = video_state(self.now_us - round(script.latency_s * S), self.frames_us)
        failing = script.disk_fails is not None and _within(script.disk_fails, at_s)
        if script.events is not None and _within(script.events, at_s):
            for k in range(20):
                text = f"link udpin:0.0.0.0:14550: system id {k + 60} is received for the first time"
                self.loop.add_event(Event(t_us=self.now_us, level="info", kind="link", text=text))
        self.loop.health = Health(
            fps=script.fps if video == "ok" else 0.0,
            video=video,
            keys=0,
            free_bytes=52_400_000_000,
            write_failing_s=at_s - script.disk_fails[0] if failing and script.disk_fails else 0.0,
            write_reason="No space left on device" if failing else "",
            links=(
                _link("udpin:0.0.0.0:14550", self.packets, silent_s),
                _link("/dev/ttyUSB0", self.packets // 10, silent_s),
            ),
        )


def video_state(now_us: int, frames_us: Sequence[int]) -> str:
    """What a flight's monitor says of a video of which frames were taken then, at a time less its latency, Unix µs."""
    if not frames_us:
        return "waiting"
    return "stalled" if now_us - frames_us[-1] > stall_after_s(frames_us[-PACE_FRAMES:]) * S else "ok"


def _link(name: str, packets: int, silent_s: float) -> LinkHealth:
    return LinkHealth(name=name, packets=packets, bad=0, dropped=0, silent_s=max(silent_s, 0.0))


def _within(span: Span, at_s: float) -> bool:
    return span[0] <= at_s < span[1]


def _scenario(script: Script) -> Scenario:
    ground = ScenarioGround(kind=script.ground, vehicles=script.vehicles, spacing_m=7.0, lanes=3)  # type: ignore[arg-type]
    return Scenario(
        name=script.name,
        seed=7,
        duration_s=max(script.seconds, 1.0),
        fps=script.fps,
        camera=CAMERA,
        ground=ground,
        faults=script.faults,
        scenery="dressed" if script.filmed else "bare",
    )


def _mission(script: Script, scenario: Scenario) -> Mission:
    ground = [{"system_id": i, "name": script.names.get(i, f"UGV-{i}")} for i in scenario.ugv_ids]
    camera = {name: getattr(CAMERA, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    return parse_mission({"uav": {"system_id": UAV_ID}, "ugv": ground, "camera": camera}, "mission")


def _datagrams(script: Script, world: World) -> Iterator[_ScriptedPacket]:
    """All that is received, by time of arrival."""
    streams = [_fleet(script, world)]
    if script.impostor is not None:
        frames = impostor_frames(world.scenario, script.impostor, MavlinkEncoder(world.scenario.ugv_ids[0]))
        streams.append(_ScriptedPacket(t_us, k, IMPOSTOR_PEER, raw) for k, (t_us, raw) in enumerate(frames))
    if script.texts is not None:
        streams.append(_texts(script, world))
    return heapq.merge(*streams)


def _fleet(script: Script, world: World) -> Iterator[_ScriptedPacket]:
    rebooted = RebootedEncoder()
    for number, packet in enumerate(fleet_telemetry(world)):
        at_s = (packet.t_us - world.scenario.start_us) / S
        system_id = UAV_ID if packet.vehicle < 0 else world.scenario.ugv_ids[packet.vehicle]
        span = script.silent.get(system_id, script.silent.get(0))
        if span is not None and _within(span, at_s):
            continue
        again = span is not None and at_s >= span[1] and system_id in script.restarted
        raw = rebooted.with_boot_time_reset(packet.raw) if again else packet.raw
        yield _ScriptedPacket(packet.t_us, number, system_id + REBOOTED_PEERS * again, raw)


def _texts(script: Script, world: World) -> Iterator[_ScriptedPacket]:
    """Texts of every severity; each tenth looks like an alarm about another vehicle."""
    assert script.texts is not None
    ids = world.scenario.ugv_ids
    encoder, victim = MavlinkEncoder(ids[-1]), script.names.get(ids[0], f"UGV-{ids[0]}")
    for k in range(round((script.texts[1] - script.texts[0]) * script.texts_hz)):
        t_us = world.scenario.start_us + round((script.texts[0] + k / script.texts_hz) * S)
        text, severity = (f"{victim}: no heartbeat", 2) if k % 10 == 0 else (f"EKF3 IMU{k % 3} text {k}", k % 8)
        yield _ScriptedPacket(t_us, k, ids[-1], encoder.statustext(text, severity))


def _frames(script: Script, world: World) -> Iterator[tuple[int, Frame, Detections]]:
    """Arrival, Unix µs, of each frame, the frame, and what is detected in it."""
    film, blank = Film(world) if script.filmed else None, _image()
    model = DetectorModel(world)
    index = 0
    for k in range(round(script.seconds * script.fps)):
        at_s = k / script.fps
        found = model.detect(at_s)
        if any(_within(span, at_s) for span in script.no_frames):
            continue
        taken_us = world.scenario.start_us + round(at_s * S)
        image = film.image(at_s, k) if film else blank
        yield (
            taken_us + round(script.latency_s * S),
            Frame(index=index, t_us=taken_us, image=image),
            boxes_of(found.values),
        )
        index += 1


def _image() -> NDArray[np.uint8]:
    """(H, W, 3) with a slope of brightness, so that neighbouring cells differ."""
    across = np.linspace(60, 140, CAMERA.width)[None, :, None]
    down = np.linspace(0, 40, CAMERA.height)[:, None, None]
    return np.broadcast_to(across + down, (CAMERA.height, CAMERA.width, 3)).astype(np.uint8)
