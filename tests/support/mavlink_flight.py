"""A flight told in MAVLink: one copter, some rovers, and the fleet that hears them."""

import numpy as np

from mavlink.fleet.fleet import Fleet
from mavlink.geodesy import LocalFrame
from mavlink.protocol.encoder import COPTER, ROVER
from mavlink.protocol.packet import Packet
from tests.support.message_encoder import MessageEncoder

T0 = 1_790_000_000_000_000
S = 1_000_000
FIELD = LocalFrame(-35.363, 149.165, 584.0)
SPEED = 4.0


class World:
    """A hovering copter 1 and rovers 11 .. on straight lines north, speaking into a fleet."""

    def __init__(self, rovers=2, **options):
        self.ids = list(range(11, 11 + rovers))
        self.fleet = Fleet(1, self.ids, **options)
        self.speakers = {i: MessageEncoder(i) for i in [1, *self.ids]}
        self.booted_us = {i: T0 - (50 + i) * S for i in self.speakers}
        self.notices = []

    def boot_ms(self, system_id, t_us):
        return (t_us - self.booted_us[system_id]) // 1000

    def feed(self, frame, t_us):
        notices = self.fleet.add_packet(Packet(t_us, frame))
        self.notices += notices
        return notices

    def rover_truth(self, system_id, t_us):
        return np.array([10.0 * (system_id - 11), SPEED * (t_us - T0) * 1e-6, 0.0])

    def rover(self, system_id, t_us, *, alt=None, heading=0.0, delay_us=0, v=SPEED, shift=0.0):
        east, north, _ = self.rover_truth(system_id, t_us)
        lat, lon, up = (float(a) for a in FIELD.to_geodetic([east + shift, north, 0.0]))
        frame = self.speakers[system_id].global_position_int(
            self.boot_ms(system_id, t_us), lat, lon, up if alt is None else alt, 0.0, (v, 0, 0), heading
        )
        return self.feed(frame, t_us + delay_us)

    def copter(self, t_us, *, up=40.0):
        lat, lon, alt = (float(a) for a in FIELD.to_geodetic([0.0, 0.0, up]))
        frame = self.speakers[1].global_position_int(self.boot_ms(1, t_us), lat, lon, alt, up, (0, 0, 0), 0.5)
        return self.feed(frame, t_us)

    def attitude(self, t_us, yaw=0.5, system_id=1, rate=0.0, pitch=0.0):
        boot_ms = self.boot_ms(system_id, t_us)
        return self.feed(self.speakers[system_id].attitude(boot_ms, 0.0, pitch, yaw, (0, 0, rate)), t_us)

    def run(self, seconds, start_us=T0, ids=None):
        """Positions at 5 Hz, attitude of the copter at 20 Hz, heartbeats at 1 Hz."""
        ids = [1, *self.ids] if ids is None else ids
        for tick in range(int(seconds * 20)):
            t_us = start_us + tick * 50_000
            if 1 in ids:
                self.attitude(t_us)
            if tick % 4 == 0:
                if 1 in ids:
                    self.copter(t_us)
                for i in set(ids) - {1}:
                    self.rover(i, t_us)
            if tick % 20 == 0:
                for i in ids:
                    kind, mode = (COPTER, 4) if i == 1 else (ROVER, 10)
                    self.feed(self.speakers[i].heartbeat(kind, custom_mode=mode), t_us)
        return start_us + int(seconds * S)
