"""Vehicles on the air before a station: what they send goes through the fold, and the alarms that come are kept."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fold.pipeline import Pipeline
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


def filter_status(flags=0x033F, position=0.01, compass=0.01):
    """EKF_STATUS_REPORT once a second."""
    report = dialect.MAVLink_ekf_status_report_message(flags, 0.01, position, 0.01, compass, 0.0)
    return lambda speaker, t_us: [speaker.pack(report)]
