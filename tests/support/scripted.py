"""A flight in simulated time through the classes of a real one, from the datagrams' bytes to the session folder.

The receiver with its log, the memory between the processes, the fold, the tracker, the identifier and the recorder are
the flight's own; sockets, the decoder and the network are left out, and time is simulated. So every fault occurs at an
exact time, and a minute of flight takes seconds.
"""

from __future__ import annotations

import heapq
import math
import os
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega

from gcs.flight.frame_loop import FrameLoop
from gcs.fold.pipeline import Pipeline
from gcs.health.faults import Faults
from gcs.mission.mission import Mission, parse_mission
from gcs.session.metadata import key_notes
from gcs.session.recorder import Recorder
from gcs.snapshot import Snapshot
from infra.wall_clock import ClockWatch
from mavlink.ingest.ingest_memory import IngestMemory, Slot, make_ingest_memory
from mavlink.ingest.plan import Signing
from mavlink.ingest.receiver import Receiver, Signatures
from mavlink.links.batch import Batch
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.encoder import GCS, MavlinkEncoder
from mavlink.protocol.framing import checksum
from mavlink.protocol.packet import Packet
from mavlink.signing.keys import Key, read_ring, write_key
from mavlink.signing.streams import ticks_of
from mavlink.tlog.writer import TlogWriter
from sim.render.film import Film
from sim.telemetry.detections import DetectorModel
from sim.telemetry.vehicle_telemetry import TELEMETRY_FROM_S, fleet_telemetry
from sim.world.scenario import UAV_ID, Scenario, ScenarioCamera
from sim.world.world import World
from vision.detect.detections import Detections
from vision.video.video import Frame

FIRST_BOOT_MS = 1500
"""Time since boot of a vehicle at its first message, ms: it was just switched on."""
SECRET = bytes(range(32))


class RebootedEncoder:
    """Frames of a fleet whose boot clocks begin again."""

    def __init__(self) -> None:
        self._parser: Any = ardupilotmega.MAVLink(None)
        self._encoders: dict[int, MavlinkEncoder] = {}
        self._booted_ms: dict[int, int] = {}

    def with_boot_time_reset(self, raw: bytes) -> bytes:
        (message,) = self._parser.parse_buffer(raw)
        system_id = message.get_srcSystem()
        if hasattr(message, "time_boot_ms"):
            booted_ms = self._booted_ms.setdefault(system_id, message.time_boot_ms - FIRST_BOOT_MS)
            message.time_boot_ms -= booted_ms
        return self._encoders.setdefault(system_id, MavlinkEncoder(system_id)).pack(message)


class ScriptedSigner:
    """Signs frames, with timestamps that follow the clock.

    Args:
        secret: 32 bytes.
    """

    def __init__(self, secret: bytes = SECRET) -> None:
        self._key, self._ticks = Key(secret), 0

    def sign(self, raw: bytes, t_us: int) -> bytes:
        packet = Packet(t_us, raw)
        body = bytes([raw[0], raw[1], raw[2] | 1]) + raw[3 : 10 + raw[1]]
        crc = checksum(body, DEFINITIONS[packet.message_id][1]).to_bytes(2, "little")
        self._ticks = max(self._ticks + 1, ticks_of(t_us))
        covered = body + crc + b"\x01" + self._ticks.to_bytes(6, "little")
        return covered + self._key.signature(covered)


S = 1_000_000
BATCH_US = 4_000
"""Datagrams of one link that arrive within this time are received as one batch."""
IDLE_US = 200_000
"""After this time without a frame the fold runs on telemetry alone."""
CAMERA = ScenarioCamera(width=640, height=360, fx=400.0, fy=400.0, cx=320.0, cy=180.0)
MISSION_CAMERA_SCALE = 3
"""The mission describes the camera at this many times the frames' size, so that intrinsics must be scaled."""
IMPOSTOR_M, IMPOSTOR_PEER = 120.0, 77
"""Distance of the forged positions, north of the scenario's origin, and the number of the address they come from."""

TEXTS_HZ = 40.0
"""Rate of the texts of a vehicle that sends them without end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectedFaults:
    """Faults to inject, with their times in seconds since the first frame; None or 0: never."""

    restart: tuple[float, float] | None = None
    """The fleet is switched off and on again at these times."""
    no_video: tuple[tuple[float, float], ...] = ()
    """No frame arrives between these times."""
    no_telemetry: tuple[float, float] | None = None
    """No telemetry arrives between these times."""
    late_stamp_s: float = 0.0
    """Delay of the frames' time stamps after their exposure."""
    step: tuple[float, float] | None = None
    """Time at which the wall clock is set, and by how much, seconds."""
    second_link_s: float = 0.0
    """Delay of a second link that repeats all telemetry."""
    impostor: tuple[float, float] | None = None
    """A second sender uses the first ground vehicle's id."""
    resized_s: float | None = None
    """Time from which on frames have half the size."""
    killed_s: tuple[float, ...] = ()
    """The receiving process is killed and replaced."""
    ring_bytes: int = 1 << 20
    """Size of the shared memory between the processes."""
    fold_stalled: tuple[float, float] | None = None
    """The fold does not run between these times."""
    station_sends: bool = False
    """The station sends a heartbeat every second."""
    signed: bool = False
    """The fleet signs, and another sender forges its messages."""
    wrong_keys: frozenset[int] = frozenset()
    """System ids that sign with a key that the station does not have for them."""
    no_detections: tuple[float, float] | None = None
    """The detector finds nothing."""
    detector_fails: tuple[float, float] | None = None
    """The detector raises an error."""
    rendered: bool = False
    """Frames show the scene, so that they tell how the camera moves; else they are black."""
    restarted: frozenset[int] = frozenset()
    """System ids of silent vehicles that are switched on again when they speak again: their clocks begin anew."""
    texts: tuple[float, float] | None = None
    """The last ground vehicle sends texts without end, some of which look like alarms of this station."""
    arrives_s: tuple[float, float] = (0.05, 0.12)
    """Least and greatest time from a frame's exposure until it is here."""
    detector_s: tuple[float, float] = (0.02, 0.3)
    """Least and greatest time that the detector takes for a frame."""


class _ScriptedLink:
    """A link that only has a name and addresses."""

    def __init__(self, name: str) -> None:
        self.name = name

    def address(self, peer: int) -> str:
        return f"192.0.2.{peer}:14550"

    def trust(self, peers: Set[int], t_us: int) -> None:
        pass

    def send(self, data: bytes, peer: int = 0) -> None:
        pass


class ScriptedDetector:
    """Returns the boxes that the script sets."""

    def __init__(self) -> None:
        self.boxes = Detections.empty()
        self.fails = False

    def detect(self, image: NDArray[np.uint8], *, gsd_m: float | None = None) -> Detections:
        if self.fails:
            raise RuntimeError("no device")
        return self.boxes


@dataclass(frozen=True, slots=True, order=True)
class _Datagram:
    t_us: int
    number: int
    link: int
    peer: int
    raw: bytes


class ScriptedFlight:
    """The flight's own objects, run on simulated time."""

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        faults: InjectedFaults,
        on_snapshot: Callable[[Snapshot], None],
        view: int = 0,
        names: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        self.scenario, self.faults, self.start_us = scenario, faults, scenario.start_us
        self.packets = self.packet_us = 0
        """Number of packets received, and the true time of the last, Unix µs."""
        self.t_us = self.start_us + round(TELEMETRY_FROM_S * S)
        """True time."""
        self.view = view
        self.mission = _mission(scenario, names).views[view]
        keys = folder / "keys"
        if faults.signed:
            keys.mkdir(mode=0o700, parents=True)
            for system_id in (*_aircraft(scenario), *scenario.ugv_ids):
                write_key(keys, system_id, SECRET)
        self.signing = Signing(keys=str(keys) if faults.signed else "")
        notes = {"keys": key_notes(read_ring(keys))} if faults.signed else {}
        self.recorder = Recorder(folder / "sessions", self.mission, video=True, notes=notes)
        self.memory_fd = make_ingest_memory(faults.ring_bytes)
        self.memory = IngestMemory(self.memory_fd)
        self.links = [_ScriptedLink("first"), _ScriptedLink("second")]
        self.log, self.receiver = self._receive(None)
        self.detector = ScriptedDetector()
        self.pipeline = Pipeline(self.mission, ("first", "second"), lambda link, peer: self.links[link].address(peer))
        fault_log = Faults(self.recorder.folder / "faults.txt")
        parts = (self.pipeline, self.detector, self.recorder, fault_log)
        self.fold = FrameLoop(*parts, on_snapshot, now_us=self.wall_us)

    def wall_us(self, t_us: int | None = None) -> int:
        """Reading of the wall clock at a true time, now by default."""
        t_us, step = self.t_us if t_us is None else t_us, self.faults.step
        return t_us + (round(step[1] * S) if step and t_us >= self.start_us + step[0] * S else 0)

    def receive(self, datagrams: list[_Datagram]) -> None:
        """Receive one batch of a link."""
        self.t_us = max(self.t_us, datagrams[-1].t_us)
        self.packets += len(datagrams)
        self.packet_us = datagrams[-1].t_us
        batch = Batch(
            times_us=[self.wall_us(each.t_us) for each in datagrams],
            frames=[each.raw for each in datagrams],
            peers=[each.peer for each in datagrams],
        )
        self.receiver.receive_batch(datagrams[0].link, batch)

    def kill_receiver(self) -> None:
        """Replace the receiver; the new one continues in the next segment of the log."""
        records = self.log.records
        self.log.close()
        self.log, self.receiver = self._receive(records)

    def run_fold(self, frame: Frame | None) -> None:
        """Run the fold once, with the newest frame or None."""
        self.fold.add_packets(self.memory.take_packets(), self.wall_us())
        self.fold.run_once(frame)

    def close(self) -> Path:
        self.fold.close()
        self.log.close()
        self.recorder.close(self.log.state, refused=self.memory.slots[Slot.REFUSED])
        os.close(self.memory_fd)
        return self.recorder.folder

    def _receive(self, records: int | None) -> tuple[TlogWriter, Receiver]:
        clock = ClockWatch(lambda: self.wall_us() * 1000, lambda: self.t_us * 1000)
        log = TlogWriter(self.recorder.tlog_path, resume_after=records, clock=clock)
        signatures = Signatures(self.signing)
        return log, Receiver(self.links, log, self.memory, signatures, None)  # type: ignore[arg-type]


def fly(
    folder: Path,
    scenario: Scenario,
    faults: InjectedFaults,
    on_snapshot: Callable[[Snapshot], None] = lambda snapshot: None,
    before_turn: Callable[[ScriptedFlight, Frame | None], None] = lambda flight, frame: None,
    *,
    view: int = 0,
    names: Mapping[int, str] = MappingProxyType({}),
) -> Path:
    """Fly a scenario with injected faults; returns the session folder.

    Args:
        folder: where to record.
        scenario: what is flown; its camera is replaced by a small one that looks straight down.
        faults: what goes wrong.
        on_snapshot: called with what a screen shows after each turn of the fold.
        before_turn: called with the flight, and the frame that came, before each turn: what its monitor finds and its
            operator does.
        view: which of the scenario's cameras films, 0 the first.
        names: of ground vehicles, by system id; ``UGV-<id>`` for the rest.
    """
    scenario = replace(scenario, camera=replace(CAMERA, mount=scenario.camera.mount))
    flight = ScriptedFlight(folder, scenario, faults, on_snapshot, view, names)
    rng = np.random.default_rng(scenario.seed)
    worlds = _worlds(scenario, faults)
    datagrams = heapq.merge(*(_fleet_datagrams(world, start_s, stop_s, flight) for world, start_s, stop_s in worlds))
    batches = _batches(datagrams)
    waiting = next(batches, None)
    stop_us = scenario.start_us + round(scenario.duration_s * S)
    frames = _frames(worlds, flight, rng)
    coming = next(frames, None)
    sent_us, kills = 0, sorted(faults.killed_s)
    while flight.t_us < stop_us:
        newest: Frame | None = None
        idle_us = flight.t_us + IDLE_US
        while coming is not None and coming[0] <= idle_us and newest is None:
            # the newest frame that has arrived when the fold runs; of earlier ones only the times are recorded
            ready_us = max(coming[0], flight.t_us)
            while coming is not None and coming[0] <= ready_us:
                newest, flight.detector.boxes, flight.detector.fails = coming[1], coming[2], coming[3]
                flight.recorder.frame_time(newest.index, newest.t_us)
                coming = next(frames, None)
            idle_us = ready_us
        while waiting is not None and waiting[-1].t_us <= idle_us:
            flight.receive(waiting)
            waiting = next(batches, None)
        flight.t_us = idle_us
        if kills and flight.t_us >= flight.start_us + kills[0] * S:
            kills.pop(0)
            flight.kill_receiver()
        if faults.station_sends and flight.t_us >= sent_us + S:
            sent_us = flight.t_us
            with patch("mavlink.ingest.receiver.now_us", flight.wall_us):
                flight.receiver.send(0, MavlinkEncoder(255).heartbeat(GCS))
        before_turn(flight, newest)
        flight.run_fold(newest)
        if newest is not None:
            flight.t_us += int(rng.uniform(*faults.detector_s) * S)  # the detector's run time
        if faults.fold_stalled and within(faults.fold_stalled, flight.t_us - flight.start_us):
            flight.t_us = flight.start_us + round(faults.fold_stalled[1] * S)
    return flight.close()


def _mission(scenario: Scenario, names: Mapping[int, str]) -> Mission:
    camera = {
        name: getattr(CAMERA, name) * MISSION_CAMERA_SCALE for name in ("width", "height", "fx", "fy", "cx", "cy")
    }
    ugvs = [{"system_id": i, "name": names.get(i, "")} for i in scenario.ugv_ids]
    table: dict[str, Any] = {"uav": {"system_id": UAV_ID}, "ugv": ugvs}
    table["camera"] = camera | {"mount": scenario.camera.mount}
    table["view"] = [{"system_id": i, "camera": table["camera"]} for i in _aircraft(scenario)[1:]]
    return parse_mission(table, "mission")


def _aircraft(scenario: Scenario) -> list[int]:
    """System ids of those that film."""
    return [UAV_ID + k for k in range(len(scenario.views) + 1)]


def within(span: tuple[float, float] | None, since_us: float) -> bool:
    """True when a time since the first frame, µs, lies in a span, seconds; False without a span."""
    return span is not None and span[0] * S <= since_us < span[1] * S


def _worlds(scenario: Scenario, faults: InjectedFaults) -> list[tuple[World, float, float]]:
    """Worlds with their begin and end, s; after a restart everything begins again."""
    if faults.restart is None:
        return [(World(scenario), TELEMETRY_FROM_S, scenario.duration_s)]
    off_s, on_s = faults.restart
    # telemetry begins before the first frame
    second = World(replace(scenario, start_us=scenario.start_us + round((on_s - TELEMETRY_FROM_S) * S)))
    return [(World(scenario), TELEMETRY_FROM_S, off_s), (second, on_s, scenario.duration_s)]


def _fleet_datagrams(world: World, start_s: float, stop_s: float, flight: ScriptedFlight) -> Iterator[_Datagram]:
    """Datagrams of one world over all links, forged ones included, by time of arrival."""
    faults, base_us = flight.faults, flight.start_us
    streams = [_link_datagrams(world, start_s, stop_s, flight, link=0, delay_us=0)]
    if faults.second_link_s:
        delay_us = round(faults.second_link_s * S)
        streams.append(_link_datagrams(world, start_s, stop_s, flight, link=1, delay_us=delay_us))
    if faults.impostor or faults.signed:
        streams.append(_forged_datagrams(world, flight))
    if faults.texts:
        streams.append(_text_datagrams(world, flight, faults.texts))
    for datagram in heapq.merge(*streams):
        if not within(faults.no_telemetry, datagram.t_us - base_us):
            yield datagram


def _link_datagrams(
    world: World, start_s: float, stop_s: float, flight: ScriptedFlight, *, link: int, delay_us: int
) -> Iterator[_Datagram]:
    """Datagrams of one world over one link, delayed, by time of arrival."""
    keyed = {
        i: ScriptedSigner(SECRET[::-1] if i in flight.faults.wrong_keys else SECRET) for i in world.scenario.ugv_ids
    }
    keyed |= {i: ScriptedSigner() for i in _aircraft(world.scenario)}
    rebooted = RebootedEncoder()
    silences = [f for f in world.scenario.faults if world.scenario.ugv_ids[f.vehicle] in flight.faults.restarted]
    on_s = {fault.vehicle: fault.stop_s for fault in silences}
    for number, packet in enumerate(fleet_telemetry(world, views=world.views)):
        if start_s * S <= packet.t_us - flight.start_us < stop_s * S:
            again = start_s > 0 or packet.t_us - flight.start_us >= S * on_s.get(packet.vehicle, math.inf)
            raw = rebooted.with_boot_time_reset(packet.raw) if again else packet.raw
            if flight.faults.signed:
                raw = keyed[Packet(packet.t_us, raw).system_id].sign(raw, packet.t_us)
            yield _Datagram(packet.t_us + delay_us, number, link, packet.vehicle + 2 + 100 * again, raw)


def _forged_datagrams(world: World, flight: ScriptedFlight) -> Iterator[_Datagram]:
    """A second sender under the first ground vehicle's id, elsewhere; without its key."""
    faults = flight.faults
    encoder = MavlinkEncoder(world.scenario.ugv_ids[0], key=bytes(32) if faults.signed else None)
    span = faults.impostor or (TELEMETRY_FROM_S, world.scenario.duration_s)
    for k, (t_us, raw) in enumerate(impostor_frames(world.scenario, span, encoder)):
        yield _Datagram(t_us, k, 0, IMPOSTOR_PEER, raw)


def _text_datagrams(world: World, flight: ScriptedFlight, span: tuple[float, float]) -> Iterator[_Datagram]:
    """Texts of every severity from the last ground vehicle; each tenth looks like an alarm about the first."""
    ids = world.scenario.ugv_ids
    encoder, victim = MavlinkEncoder(ids[-1]), flight.mission.name_of(ids[0])
    for k in range(round((span[1] - span[0]) * TEXTS_HZ)):
        t_us = world.scenario.start_us + round((span[0] + k / TEXTS_HZ) * S)
        text, severity = (f"{victim}: no heartbeat", 2) if k % 10 == 0 else (f"EKF3 IMU{k % 3} text {k}", k % 8)
        yield _Datagram(t_us, k, 0, len(ids) + 1, encoder.statustext(text, severity))


def impostor_frames(
    scenario: Scenario, span: tuple[float, float], encoder: MavlinkEncoder
) -> Iterator[tuple[int, bytes]]:
    """Unix µs and frames of who reports a place of its own five times a second, in a span since the first frame, s."""
    place = (scenario.latitude_deg + IMPOSTOR_M / 111_000, scenario.longitude_deg, scenario.altitude_m, 0.0)
    for k in range(round((span[1] - span[0]) * 5)):
        t_us = scenario.start_us + round((span[0] + k / 5) * S)
        yield t_us, encoder.global_position_int(900_000 + 200 * k, *place, (3.0, 0, 0), 0.0)
        if k % 5 == 0:
            yield t_us + 1000, encoder.heartbeat()


def _batches(datagrams: Iterator[_Datagram]) -> Iterator[list[_Datagram]]:
    """Group consecutive datagrams of one link into batches."""
    batch: list[_Datagram] = []
    for datagram in datagrams:
        if batch and (datagram.link != batch[0].link or datagram.t_us - batch[0].t_us > BATCH_US):
            yield batch
            batch = []
        batch.append(datagram)
    if batch:
        yield batch


def _frames(
    worlds: list[tuple[World, float, float]], flight: ScriptedFlight, rng: np.random.Generator
) -> Iterator[tuple[int, Frame, Detections, bool]]:
    """Arrival time, Unix µs, of each frame, the frame, its detections, and whether the detector fails on it."""
    faults, index, last_us = flight.faults, 0, 0
    images = [np.zeros((CAMERA.height // k, CAMERA.width // k, 3), dtype=np.uint8) for k in (1, 2)]
    for world, start_s, stop_s in worlds:
        seen, scenario = world.seen_from(flight.view + 1) if flight.view else world, world.scenario
        model = DetectorModel(seen)
        film = Film(seen) if faults.rendered else None
        for k in range(round(scenario.duration_s * scenario.fps)):
            t = k / scenario.fps
            exposed_us = scenario.start_us + round(t * S)
            since_us = exposed_us - flight.start_us
            found = model.detect(t)
            if not start_s * S <= since_us < stop_s * S or any(within(span, since_us) for span in faults.no_video):
                continue
            small = faults.resized_s is not None and since_us >= faults.resized_s * S
            stamp_us = flight.wall_us(exposed_us) + round(faults.late_stamp_s * S)
            last_us = max(stamp_us, last_us + 1)  # strictly increasing, as the video process makes them
            boxes = Detections.empty() if within(faults.no_detections, since_us) else boxes_of(found.values, small)
            image = images[small] if film is None else cv2.resize(film.image(t, index), images[small].shape[1::-1])
            frame = Frame(index=index, t_us=last_us, image=np.asarray(image, np.uint8))
            yield (
                exposed_us + int(rng.uniform(*faults.arrives_s) * S),
                frame,
                boxes,
                within(faults.detector_fails, since_us),
            )
            index += 1


def boxes_of(values: NDArray[np.float64], small: bool = False) -> Detections:
    """Rows of the detector's model as boxes; of frames of half the size."""
    scale = np.array([*[0.5 if small else 1.0] * 4, 1.0, 1.0, 1.0])
    cx, cy, w, h, angle, score, heading = (values * scale).T
    return Detections(cx=cx, cy=cy, w=w, h=h, angle=angle, score=score, heading=heading)
