"""Scripted flights whose truth is known by construction: recorded as a flight records, with what was so beside it.

Telemetry, signatures, fold and recorder are the flight's own (``tests.support.scripted``); members fall silent, are
late, stand still, lie, are refused or never heard, the video stops or comes and goes, an operator states and marks.
Screens ask oftener than the fold runs, as in a flight.
"""

from __future__ import annotations

import tempfile
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Event, Health, LinkHealth, Snapshot, Statement
from mavlink.protocol.packet import Packet
from sim.telemetry.detections import DetectorModel
from sim.telemetry.vehicle_telemetry import fleet_telemetry
from sim.world.boxes import true_boxes
from sim.world.scenario import UAV_ID, Gnss, Occlusion, Scenario, ScenarioFault, ScenarioGround, ScenarioView, Targets
from sim.world.world import World
from tests.support.scripted import CAMERA, InjectedFaults, ScriptedFlight, fly, within
from vision.stream.pace import PACE_FRAMES, stall_after_s
from vision.video.video import Frame

S = 1_000_000
HEARTBEAT, GLOBAL_POSITION_INT = 0, 33
MONITOR_US = 500_000
LINKS = ("udpin:0.0.0.0:14550", "/dev/ttyUSB0")
NEWS = 20
"""Events of a flood at each look of the monitor."""
Span = tuple[float, float]
"""Begin and end, seconds since the first frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Received:
    """Times at which a heartbeat and a position of a vehicle came last that can be believed, Unix µs, 0 never."""

    heartbeat_us: int = 0
    position_us: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """Input of a screen at one time, and the truth beside it."""

    now_us: int
    snapshot: Snapshot
    events: tuple[Event, ...]
    received: Mapping[int, Received]
    """Last reception of each vehicle, by system id; a second sender of an id does not count."""
    frame_us: int
    """Time at which the newest frame was taken, Unix µs, 0 before the first."""
    named: Mapping[int, str]
    """Standing of each ground vehicle at the newest snapshot, by system id."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorAct:
    """One act of the operator."""

    at_s: float
    kind: str
    """``state`` a name, ``undo`` it, ``mark``, ``seen``: acknowledge all alarms."""
    of: int = 0
    """System id of the vehicle whose box is meant, or that a mark is about."""
    says: int = 0
    """The system id that is stated, 0 none of ours."""
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightScript:
    """Course of one flight. Vehicles are 11, 12, … in the order of ``faults``' indices; the last are outside."""

    name: str
    seconds: float = 24.0
    fps: float = 5.0
    vehicles: int = 5
    outside: int = 0
    strangers: int = 1
    ground: Literal["curved", "open"] = "curved"
    names: Mapping[int, str] = field(default_factory=dict)
    """Names of ground vehicles, by system id; ``UGV-<id>`` for the rest."""
    seed: int = 7
    faults: tuple[ScenarioFault, ...] = ()
    occlusions: tuple[Occlusion, ...] = ()
    injected: InjectedFaults = field(default_factory=InjectedFaults)
    acts: tuple[OperatorAct, ...] = ()
    views: tuple[ScenarioView, ...] = ()
    """Further cameras, which nobody operates."""
    no_video_beside: tuple[Span, ...] = ()
    """Spans without a frame of the further cameras."""
    events: Span | None = None
    """Links report without end."""
    disk_fails: Span | None = None
    poll_us: int = 83_333
    """A screen polls twelve times a second."""

    @property
    def scenario(self) -> Scenario:
        """The flight as the simulator takes it."""
        return Scenario(
            name=self.name,
            seed=self.seed,
            duration_s=self.seconds,
            fps=self.fps,
            camera=CAMERA,
            ground=ScenarioGround(
                kind=self.ground, vehicles=self.vehicles, outside=self.outside, spacing_m=8.0, lanes=2, bend_deg=35.0
            ),
            gnss=Gnss(white_m=0.3, bias_m=0.5),
            targets=Targets(parked_lookalikes=self.strangers),
            faults=self.faults,
            occlusions=self.occlusions,
            scenery="dressed" if self.injected.rendered else "bare",
            views=tuple(replace(view, camera=CAMERA) for view in self.views),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueFrame:
    """Truth of one frame."""

    t_us: int
    boxes: NDArray[np.float64]
    """(m, 4) cx, cy, size, score of what the detector finds."""
    system_id: NDArray[np.int64]
    """(m,) whose each is, 0 nobody's."""
    places: Mapping[int, tuple[float, float]]
    """Place of each vehicle of ours in the image plane, px, also outside of the frame."""

    def whose(self, cx: float, cy: float) -> int | None:
        """System id of the box at a place, 0 none of ours, None: no box was found there."""
        if not len(self.boxes):
            return None
        away = np.hypot(self.boxes[:, 0] - cx, self.boxes[:, 1] - cy) / self.boxes[:, 2]
        best = int(np.argmin(away))
        return int(self.system_id[best]) if away[best] < 0.5 else None

    def outside_px(self, system_id: int) -> float:
        """Distance of a vehicle from the frame, px, negative inside."""
        x, y = self.places[system_id]
        return max(-x, x - CAMERA.width, -y, y - CAMERA.height)


@dataclass(frozen=True, kw_only=True)
class TrueFlight:
    """A flight that was flown: what it said is in its moments and its folder, all else here is the truth."""

    script: FlightScript
    folder: Path
    moments: Sequence[Moment]
    """One a turn of the fold."""
    turns: Sequence[tuple[int, int]]
    """Times of each turn and of the frame that came with it, Unix µs, 0 none."""
    acted: Sequence[tuple[int, OperatorAct, int]]
    """Acts of the operator: time, Unix µs, act, and the track that was meant."""
    heartbeats: Mapping[int, Sequence[int]]
    """Arrival, Unix µs, of each vehicle's that can be believed, by system id."""
    positions: Mapping[int, Sequence[int]]
    refused: Mapping[int, int]
    """Packets that must not be believed, by system id."""
    frames: Mapping[int, TrueFrame]
    """Every frame that was looked at, by the time it was taken."""
    uav_id: int = UAV_ID
    """System id of the aircraft that films."""
    beside: tuple[TrueFlight, ...] = ()
    """The same flight as each further camera has it."""

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario that was flown."""
        return self.script.scenario

    @cached_property
    def logged(self) -> Sequence[tuple[int, str]]:
        """Time, Unix µs, and text of every event that the screens had."""
        return [(event.t_us, event.text) for event in self.moments[-1].events]

    @cached_property
    def _frame_times_us(self) -> Sequence[int]:
        return sorted(self.frames)

    @cached_property
    def tracks(self) -> Mapping[int, Sequence[tuple[int, int | None]]]:
        """Frames in which each track was found, by track: time, Unix µs, and whose box it was then."""
        found = defaultdict[int, list[tuple[int, int | None]]](list)
        for moment in self.moments:
            if (frame := self.frames.get(moment.snapshot.t_us)) is None:
                continue
            for box in moment.snapshot.new_boxes:
                if box.track_id and not box.coasting:
                    found[box.track_id].append((frame.t_us, frame.whose(box.cx, box.cy)))
        return found

    def whose_track(self, track: int, t_us: int) -> int | None:
        """System id of the box that a track had then or last, 0 none of ours, None unknown."""
        at = bisect_right(seen := self.tracks.get(track, ()), t_us, key=lambda pair: pair[0])
        return seen[at - 1][1] if at else None

    def seen_later(self, track: int, t_us: int) -> int:
        """Time at which a track was found next, Unix µs, 0 never."""
        return next((seen_us for seen_us, _ in self.tracks.get(track, ()) if seen_us > t_us), 0)

    def polls(self) -> Iterator[Moment]:
        """The moments at which a screen polls: what it is given is as old as the last turn, the truth is not."""
        times_us = [moment.now_us for moment in self.moments]
        for now_us in range(times_us[0], times_us[-1], self.script.poll_us):
            moment = self.moments[bisect_right(times_us, now_us) - 1]
            received = _received((self.heartbeats, self.positions), moment.snapshot, now_us)
            yield replace(moment, now_us=now_us, received=received)

    def at_s(self, t_us: int) -> float:
        """Seconds since the first frame."""
        return (t_us - self.scenario.start_us) / S

    def name(self, system_id: int) -> str:
        """Name of a vehicle."""
        return "none of ours" if not system_id else f"UGV-{system_id}"

    def fault_of(self, system_id: int, t_us: int, *, within_s: float = 0.0) -> ScenarioFault | None:
        """The fault of the positions that a vehicle reports at a time, None for none.

        Args:
            system_id: of the vehicle.
            t_us: the time, Unix µs.
            within_s: a fault counts for this many seconds of film after its end, as without frames nobody notices it.
        """
        at_s = self.at_s(t_us)
        for fault in self.script.faults:
            its = self.scenario.ugv_ids[fault.vehicle] == system_id and fault.kind != "silent"
            if its and fault.start_s <= at_s and self._filmed_s(fault.stop_s, at_s) <= within_s:
                return fault
        return None

    def _filmed_s(self, start_s: float, stop_s: float) -> float:
        """Seconds of film that came between two times since the first frame; 0 where they are in the other order."""
        first, last = (self.scenario.start_us + round(min(at_s, 1e6) * S) for at_s in (start_s, stop_s))
        return (
            max(bisect_right(self._frame_times_us, last) - bisect_left(self._frame_times_us, first), 0)
            / self.script.fps
        )

    def silent_s(self, system_id: int, t_us: int, what: str = "") -> float:
        """Seconds for which nothing (``heartbeat``, ``position``) of a vehicle came that can be believed; inf never."""
        kinds = {"heartbeat": (self.heartbeats,), "position": (self.positions,)}
        last_us = max(
            _last(each.get(system_id, ()), t_us) for each in kinds.get(what, (self.heartbeats, self.positions))
        )
        return (t_us - last_us) / S if last_us else float("inf")


Heard = tuple[Mapping[int, Sequence[int]], Mapping[int, Sequence[int]]]
"""Times at which heartbeats and positions came, Unix µs, by system id."""


@dataclass(kw_only=True)
class _Surroundings:
    """Surroundings of the fold: a monitor, a screen, and an operator who acts."""

    script: FlightScript
    acts: list[OperatorAct]
    frames: Mapping[int, TrueFrame]
    heard: Heard
    moments: list[Moment] = field(default_factory=list)
    turns: list[tuple[int, int]] = field(default_factory=list)
    acted: list[tuple[int, OperatorAct, int]] = field(default_factory=list)
    frames_us: list[int] = field(default_factory=list)
    checked_us: int = 0
    flight: ScriptedFlight | None = None

    def before_turn(self, flight: ScriptedFlight, frame: Frame | None) -> None:
        """Twice a second the monitor looks."""
        self.flight = flight
        self.turns.append((flight.t_us, frame.t_us if frame is not None else 0))
        self.frames_us += [frame.t_us] if frame is not None else []
        if flight.t_us - self.checked_us >= MONITOR_US:
            self.checked_us = flight.t_us
            self._monitor(flight)
        while self.acts and flight.t_us >= flight.start_us + self.acts[0].at_s * S:
            self._act(flight, self.acts.pop(0))

    def _monitor(self, flight: ScriptedFlight) -> None:
        script, since_us = self.script, flight.t_us - flight.start_us
        silent_s = (flight.t_us - flight.packet_us) / S if flight.packets else float("inf")
        video = video_state(flight.t_us - round(script.injected.arrives_s[1] * S), self.frames_us)
        failing = script.disk_fails is not None and within(script.disk_fails, since_us)
        if within(script.events, since_us):
            for k in range(NEWS):
                text = f"link {LINKS[0]}: system id {k + 60} is received for the first time"
                flight.fold.add_event(Event(t_us=flight.t_us, level="info", kind="link", text=text))
        flight.fold.health = Health(
            fps=script.fps if video == "ok" else 0.0,
            video=video,
            keys=len(flight.scenario.ugv_ids) * flight.faults.signed,
            free_bytes=50_000_000_000,
            write_failing_s=since_us / S - script.disk_fails[0] if script.disk_fails and failing else 0.0,
            write_reason="No space left on device" if failing else "",
            links=tuple(
                LinkHealth(name=name, packets=flight.packets // share, bad=0, dropped=0, silent_s=silent_s)
                for name, share in zip(LINKS, (1, 10), strict=True)
            ),
        )

    def _act(self, flight: ScriptedFlight, act: OperatorAct) -> None:
        track, latest = 0, flight.fold.latest
        if act.kind == "mark":
            flight.fold.add_event(Event(t_us=flight.t_us, level="info", kind="mark", text=act.text, system_id=act.of))
        elif latest is not None:
            x, y = self.frames[latest.seen_us].places[act.of]
            tracked = [box for box in latest.boxes if box.track_id]
            if not tracked:
                return
            track = min(tracked, key=lambda box: np.hypot(box.cx - x, box.cy - y)).track_id
            undone = act.kind == "undo"
            flight.pipeline.state_name(Statement(track_id=track, system_id=0 if undone else act.says, undone=undone))
        self.acted.append((flight.t_us, act, track))

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Note the input of a screen."""
        assert self.flight is not None
        now_us = self.flight.t_us
        self.moments.append(
            Moment(
                now_us=now_us,
                snapshot=snapshot,
                events=tuple(self.flight.fold.events()),
                received=_received(self.heard, snapshot, now_us),
                frame_us=self.frames_us[-1] if self.frames_us else 0,
                named={row.system_id: row.standing for row in snapshot.vehicles if row.role == "ugv"},
            )
        )


def video_state(now_us: int, frames_us: Sequence[int]) -> str:
    """State of a video by a flight's monitor, from a time less its latency and the times of its frames, Unix µs."""
    if not frames_us:
        return "waiting"
    return "stalled" if now_us - frames_us[-1] > stall_after_s(frames_us[-PACE_FRAMES:]) * S else "ok"


def _received(heard: Heard, snapshot: Snapshot, now_us: int) -> Mapping[int, Received]:
    beats_us, places_us = heard
    return {
        row.system_id: Received(
            heartbeat_us=_last(beats_us.get(row.system_id, ()), now_us),
            position_us=_last(places_us.get(row.system_id, ()), now_us),
        )
        for row in snapshot.vehicles
    }


def _last(times_us: Sequence[int], now_us: int) -> int:
    """The last of them until now, 0 none."""
    at = bisect_right(times_us, now_us)
    return times_us[at - 1] if at else 0


def fly_script(script: FlightScript, folder: Path) -> TrueFlight:
    """Fly, record into a folder, and keep the truth; what further cameras record goes into folders beside it."""
    others = replace(script, acts=(), injected=replace(script.injected, no_video=script.no_video_beside))
    beside = tuple(_fly(others, folder / f"view-{k}", k) for k, _ in enumerate(script.views, 1))
    return replace(_fly(script, folder), beside=beside)


def polls_of(script: FlightScript) -> list[Moment]:
    """Inputs of a screen at each poll of a flight, whose recording is not kept."""
    with tempfile.TemporaryDirectory() as folder:
        return list(fly_script(script, Path(folder)).polls())


def _fly(script: FlightScript, folder: Path, view: int = 0) -> TrueFlight:
    """Fly with one camera, 0 the first."""
    scenario, injected = script.scenario, script.injected
    world = World(scenario)
    heartbeats, positions = (defaultdict[int, list[int]](list) for _ in range(2))
    refused = Counter[int]()
    for sent in fleet_telemetry(world, views=world.views):
        packet = Packet(sent.t_us, sent.raw)
        if within(injected.no_telemetry, sent.t_us - scenario.start_us):
            continue
        if injected.signed and packet.system_id in injected.wrong_keys:
            refused[packet.system_id] += 1
        elif packet.message_id in (HEARTBEAT, GLOBAL_POSITION_INT):
            (positions if packet.message_id else heartbeats)[packet.system_id].append(sent.t_us)
    acts = sorted(script.acts, key=lambda act: act.at_s)
    frames = {frame.t_us: frame for frame in _true_frames(world.seen_from(view + 1) if view else world)}
    station = _Surroundings(script=script, acts=acts, frames=frames, heard=(heartbeats, positions))
    recorded = fly(folder, scenario, injected, station.on_snapshot, station.before_turn, view=view, names=script.names)
    came = {frame_us for _, frame_us in station.turns}
    return TrueFlight(
        script=script,
        folder=recorded,
        moments=station.moments,
        turns=station.turns,
        acted=station.acted,
        frames={t_us: frame for t_us, frame in frames.items() if t_us in came},
        heartbeats=heartbeats,
        positions=positions,
        refused=refused,
        uav_id=UAV_ID + view,
    )


def _true_frames(world: World) -> Iterator[TrueFrame]:
    scenario, model = world.scenario, DetectorModel(world)
    for k in range(scenario.frame_count):
        at_s = k / scenario.fps
        seen, true = model.detect(at_s), true_boxes(world.view(at_s), world.bodies(at_s))
        places = zip(true.cx.tolist(), true.cy.tolist(), strict=True)
        yield TrueFrame(
            t_us=scenario.start_us + round(at_s * S),
            boxes=np.column_stack([seen.values[:, :2], seen.values[:, 2:4].max(axis=1), seen.values[:, 5]]),
            system_id=seen.system_id,
            places=dict(zip(scenario.ugv_ids, places, strict=False)),
        )
