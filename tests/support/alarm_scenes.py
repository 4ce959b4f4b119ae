"""Vehicles on the air before a station: what they send goes through the fold, and the alarms that come are kept; and
for every alarm about vehicles a scene that raises it."""

import copyreg
import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from struct import Struct

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fold.pipeline import Pipeline
from gcs.mission.fence import Fence
from gcs.mission.mission import parse_mission
from gcs.snapshot import Health
from mavlink.protocol.encoder import COPTER, ROVER, MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from tests.support.flights import FIELD, T0, S
from vision.detect.detections import Detections

UAV, UGV, OTHER = 1, 11, 12
STEP_US = 100_000
RADIUS_M, SPEED = 5.0, 4.0
SIZE, FOCAL_PX, UP_M = (1280, 720), 900.0, 40.0
CAMERA = {"width": SIZE[0], "height": SIZE[1], "fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 640.0, "cy": 360.0}
MISSION = parse_mission(
    {"uav": {"system_id": UAV}, "ugv": [{"system_id": UGV}, {"system_id": OTHER}], "camera": CAMERA}, "mission"
)


@dataclass
class Vehicle:
    """One that drives in a circle, or hovers in its middle, and what it sends."""

    system_id: int
    sends: str = "hpa"
    """Heartbeats, positions, attitudes, time (t), and zeros in place of positions (0)."""
    shift_m: float = 0.0
    """By which its reports are east of where it is."""
    drift_ppm: float = 0.0
    """By which its clock is slow."""
    peer: int = 0
    booted_us: int = T0 - 60 * S
    extra: Callable[[MavlinkEncoder, int], list[bytes]] = lambda speaker, t_us: []
    """Further frames, once a second."""
    check: Callable[[Packet], Auth] = lambda packet: Auth.OPEN
    """What its signatures are worth."""
    speaker: MavlinkEncoder = field(init=False)

    def __post_init__(self):
        self.speaker = MavlinkEncoder(self.system_id)

    def place(self, t_us):
        """East and north, and the velocity there."""
        if self.system_id == UAV:
            return (0.0, 0.0), (0.0, 0.0)
        # own middles and opposite ways round: what is late is not what is turned
        side = 1.0 if self.system_id == UGV else -1.0
        angle = side * SPEED / RADIUS_M * (t_us - T0) * 1e-6
        east, north = RADIUS_M * math.cos(angle) + side * 2.0 * RADIUS_M, RADIUS_M * math.sin(angle)
        return (east, north), (-side * SPEED * math.sin(angle), side * SPEED * math.cos(angle))

    def frames(self, t_us):
        """What is sent in the step that begins then."""
        boot_ms = int((t_us - self.booted_us) / (1.0 + self.drift_ppm * 1e-6) / 1000)
        up_m = UP_M if self.system_id == UAV else 0.0
        (east, north), (v_east, v_north) = self.place(t_us)
        heading = 0.0 if self.system_id == UAV else math.atan2(v_east, v_north)
        lat, lon, alt = (float(x) for x in FIELD.to_geodetic([east + self.shift_m, north, up_m]))
        if "0" in self.sends:
            lat = lon = 0.0
        if "p" in self.sends or "0" in self.sends:
            yield self.speaker.global_position_int(boot_ms, lat, lon, alt, up_m, (v_north, v_east, 0.0), heading)
        if "a" in self.sends:
            yield self.speaker.attitude(boot_ms, 0.0, 0.0, heading)
        if (t_us - T0) % S:
            return
        if "h" in self.sends:
            yield self.speaker.heartbeat(COPTER if self.system_id == UAV else ROVER, custom_mode=4)
        if "t" in self.sends:
            yield self.speaker.system_time(boot_ms, t_us)
        yield from self.extra(self.speaker, t_us)


class Scene:
    """All of them, and the station.

    Attributes:
        came: the alarms that ever came, by key and level.
        events: of the snapshots.
    """

    def __init__(self, *vehicles, mission=MISSION):
        given = {vehicle.system_id for vehicle in vehicles}
        self.vehicles = [*vehicles, *(Vehicle(i) for i in (UAV, UGV, OTHER) if i not in given)]
        self.pipeline = Pipeline(mission)
        self.t_us = T0
        self.health = Health(video="ok")
        self.came, self.events = {}, []
        self.frames = 0

    def run(self, seconds, *, filmed=False, video_late_s=0.0):
        """Goes on; ``filmed``: with a frame in each step, which is dated so much too late."""
        for _ in range(round(seconds * S / STEP_US)):
            for vehicle in self.vehicles:
                for raw in vehicle.frames(self.t_us):
                    packet = Packet(self.t_us, raw, 0, vehicle.peer or vehicle.system_id)
                    self.pipeline.add_packet(replace(packet, auth=vehicle.check(packet)))
            boxes = self.boxes() if filmed else None
            late_us = round(video_late_s * S)
            snapshot = self.pipeline.add_frame(
                self.frames, self.t_us + late_us, size=SIZE, detections=boxes, health=self.health
            )
            self.keep(snapshot)
            self.frames += 1
            self.t_us += STEP_US
        return self

    def keep(self, snapshot):
        self.came |= {(alarm.key, alarm.level): alarm for alarm in snapshot.alarms}
        self.events += snapshot.events

    def boxes(self):
        """The ground vehicles as a camera sees them that looks straight down, north up."""
        drivers = [Vehicle(i) for i in (UGV, OTHER)]
        places, ways = zip(*(driver.place(self.t_us) for driver in drivers), strict=True)
        (east, north), heading = np.array(places).T, np.array([math.atan2(*way) for way in ways])
        scale = FOCAL_PX / UP_M
        sides = {"w": np.full(2, 4.0 * scale), "h": np.full(2, 2.0 * scale)}
        return Detections(
            cx=640.0 + scale * east,
            cy=360.0 - scale * north,
            **sides,
            angle=heading - math.pi / 2,
            score=np.full(2, 0.9),
            heading=heading % (2 * math.pi),
        )


class FilmedScene(Scene):
    """A scene whose camera misses some vehicles, sees a stranger, and keeps the snapshots."""

    def __init__(self, *vehicles):
        super().__init__(*vehicles)
        self.hidden, self.stranger, self.pushed_px, self.kept = set(), None, 0.0, []

    def boxes(self):
        found = super().boxes()
        found = replace(found, cx=found.cx + self.pushed_px)
        rows = [k for k, vehicle in enumerate((UGV, OTHER)) if vehicle not in self.hidden]
        found = found.select(np.array(rows, dtype=np.intp))
        if self.stranger is None:
            return found
        east, north = self.stranger
        place = {"cx": 640.0 + FOCAL_PX / UP_M * east, "cy": 360.0 - FOCAL_PX / UP_M * north}
        one = {"w": 90.0, "h": 45.0, "angle": 0.3, "score": 0.9, "heading": math.nan, **place}
        names = ("cx", "cy", "w", "h", "angle", "score", "heading")
        return Detections(**{name: np.append(getattr(found, name), one[name]) for name in names})

    def keep(self, snapshot):
        super().keep(snapshot)
        self.kept.append(snapshot)

    @property
    def last(self):
        return self.kept[-1]

    def row(self, system_id):
        return next(row for row in self.last.vehicles if row.system_id == system_id)

    def box(self, system_id):
        return next(box for box in self.last.boxes if box.system_id == system_id)

    def lost(self, system_id):
        """Why it lost its name, each time."""
        said = [event for event in self.events if event.kind == "identity" and event.system_id == system_id]
        return [event.text.split(": ", 1)[1] for event in said if "no longer" in event.text and ": " in event.text]

    def __deepcopy__(self, memo):
        """Another that goes on alone from here; of what was kept nothing changes any more."""
        memo |= {id(snapshot): snapshot for snapshot in self.kept}
        other = memo[id(self)] = FilmedScene.__new__(FilmedScene)
        other.__dict__ = deepcopy(self.__dict__, memo)
        return other


# encoders hold them, and copy() knows them not
copyreg.pickle(Struct, lambda struct: (Struct, (struct.format,)))


def copied(make):
    """Wraps what makes a scene: each is flown once, and everybody gets a copy."""
    flown = cache(make)
    return lambda *arguments: deepcopy(flown(*arguments))


@copied
def filmed(seconds):
    """A scene that has been filmed for so long: both vehicles are named."""
    return FilmedScene().run(seconds, filmed=True)


def filter_status(flags=0x033F, position=0.01, compass=0.01):
    """EKF_STATUS_REPORT once a second."""
    report = dialect.MAVLink_ekf_status_report_message(flags, 0.01, position, 0.01, compass, 0.0)
    return lambda speaker, t_us: [speaker.pack(report)]


CASES = {}


def raises(key, level="alarm"):
    """Registers how an alarm is raised: a function that gives the alarms that came, by key and level."""

    def register(case):
        CASES[key, level] = case
        return case

    return register


# what vehicles send


@raises("silent")
def falls_silent():
    scene = Scene().run(3)
    scene.vehicles[1].sends = ""
    return scene.run(6).came


@raises("position", "warning")
@raises("position")
def stops_its_positions():
    scene = Scene().run(3)
    scene.vehicles[1].sends = "h"
    return scene.run(8).came


class Hung(Vehicle):
    """Its positions are those of one moment, with the times of now, or all of it as it was."""

    hung_us, timed = 0, True

    def frames(self, t_us):
        frozen = super()
        for raw in frozen.frames(t_us):
            is_position = self.hung_us and raw[7:10] == bytes([33, 0, 0])
            yield self.again(t_us) if is_position else raw

    def again(self, t_us):
        boot_ms = (t_us if self.timed else self.hung_us) - self.booted_us
        (east, north), (v_east, v_north) = self.place(self.hung_us)
        lat, lon, alt = (float(x) for x in FIELD.to_geodetic([east, north, 0.0]))
        return self.speaker.global_position_int(
            boot_ms // 1000, lat, lon, alt, 0.0, (v_north, v_east, 0.0), math.atan2(v_east, v_north)
        )


def hung(timed=True, seconds=8):
    """A vehicle whose position has stood still for so long."""
    vehicle = type("Hung", (Hung,), {"timed": timed})(UGV)
    scene = FilmedScene(vehicle).run(3)
    vehicle.hung_us = scene.t_us
    return scene.run(seconds)


@raises("frozen")
def reports_one_place_while_it_drives():
    return hung().came


@raises("refused")
def reports_zeros():
    scene = Scene().run(3)
    scene.vehicles[1].sends = "h0"
    return scene.run(4).came


@raises("no position", "warning")
def never_has_a_position():
    return Scene(Vehicle(UGV, "h")).run(12).came


@raises("doubted")
def reports_a_glitch():
    return Scene(Vehicle(UGV, extra=filter_status(flags=0x833F, position=27.0))).run(5).came


@raises("compass")
def reports_a_bad_compass():
    return Scene(Vehicle(UGV, extra=filter_status(compass=1.5))).run(5).came


class Far(Vehicle):
    """A share of what it sends is lost on the way."""

    lost = 0.0

    def frames(self, t_us):
        self.rng = getattr(self, "rng", None) or np.random.default_rng(4)
        return (raw for raw in super().frames(t_us) if self.rng.random() >= self.lost)


@raises("loss", "warning")
def is_at_the_edge_of_its_radio():
    vehicle = Far(UGV)
    vehicle.lost = 0.25
    return Scene(vehicle).run(20).came


@raises("loss")
def is_beyond_the_edge_of_its_radio():
    vehicle = Far(UGV)
    vehicle.lost = 0.75
    return Scene(vehicle).run(20).came


@raises("attitude")
def sends_no_attitude():
    return Scene(Vehicle(UAV, "hp")).run(5).came


@raises("clock", "warning")
def has_a_slow_clock():
    return Scene(Vehicle(UGV, drift_ppm=800.0)).run(80).came


@raises("contested")
def shares_its_id():
    return Scene(Vehicle(UGV), Vehicle(UGV, shift_m=-60.0, peer=99, booted_us=T0 - 900 * S)).run(8).came


@raises("conflict")
def is_filmed_elsewhere():
    scene = Scene().run(6, filmed=True)
    scene.vehicles[1].shift_m = 15.0
    return scene.run(3, filmed=True).came


@raises("unheard", "warning")
def is_never_heard():
    return Scene(Vehicle(OTHER, "")).run(17).came


def message(name, *values, **more):
    """Frames once a second of one message of the dialect."""
    made = getattr(dialect, f"MAVLink_{name}_message")(*values, **more)
    return lambda speaker, t_us: [speaker.pack(made)]


def battery(percent=80, millivolts=12_000, *, number=0, function=1, state=0):
    """BATTERY_STATUS."""
    volts = [millivolts, *[65535] * 9]
    return message("battery_status", number, function, 3, 2000, volts, 500, 100, -1, percent, charge_state=state)


def receiver(satellites=12, hdop=0.8, fix_type=3):
    """GPS_RAW_INT."""
    return lambda speaker, t_us: [
        speaker.gps_raw_int(0, -35.363, 149.165, 584.0, fix_type=fix_type, satellites=satellites, hdop=hdop)
    ]


def sensors(health, *, percent=-1, millivolts=65535, enabled=0x1FFFFFFF):
    """SYS_STATUS."""
    return message("sys_status", enabled, enabled, health, 0, millivolts, -1, percent, 0, 0, 0, 0, 0, 0)


def raised_by(extra, seconds=6, **limits):
    """Alarms of a vehicle that reports this."""
    mission = replace(MISSION, limits=replace(MISSION.limits, **limits))
    return Scene(Vehicle(UGV, extra=extra), mission=mission).run(seconds).came


@raises("battery", "warning")
def has_a_low_battery():
    return raised_by(battery(20))


@raises("battery")
def has_an_empty_battery():
    return raised_by(battery(-1, 10_400), battery_v=10.5)


@raises("reception", "warning")
def sees_few_satellites():
    return raised_by(receiver(satellites=4, hdop=3.2))


@raises("reception")
def loses_its_fix():
    return raised_by(receiver(satellites=3, fix_type=1), 15)


@raises("arming", "warning")
def fails_its_arming_checks():
    return raised_by(lambda speaker, t_us: [speaker.statustext("PreArm: compass not calibrated", 2)], 15)


@raises("part", "warning")
def has_a_broken_compass():
    return raised_by(sensors(0x1FFFFFFF & ~4), 15)


def fenced(north_m):
    """Alarms of vehicles in a field that ends so far north of where they turn."""
    corners = (-90, -90), (90, -90), (90, north_m), (-90, north_m)
    places = tuple(tuple(map(float, FIELD.to_geodetic([*corner, 0.0])[:2])) for corner in corners)
    return Scene(mission=replace(MISSION, fence=(Fence(polygon=places),))).run(8).came


@raises("fence", "warning")
def comes_near_a_fence():
    return fenced(RADIUS_M + 0.5)


@raises("fence")
def breaks_a_fence():
    return fenced(RADIUS_M - 2.0)


def with_separation(metres):
    """Alarms of two vehicles, 20 m apart and more, that must be so far apart."""
    return Scene(mission=replace(MISSION, limits=replace(MISSION.limits, separation_m=metres))).run(8).came


@raises("near", "warning")
def are_perhaps_too_near():
    return with_separation(19.0)


@raises("near")
def are_too_near():
    return with_separation(25.0)
