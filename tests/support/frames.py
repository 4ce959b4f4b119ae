"""Frames, packets and records of logs: ready made, and of messages that only tests send."""

import math
import struct

from pymavlink.dialects.v20 import ardupilotmega
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet


class MessageEncoder(MavlinkEncoder):
    """One sender that also has a gimbal, a camera and a modem."""

    def attitude_quaternion(self, boot_ms, q, rates=(0.0, 0.0, 0.0)):
        """ATTITUDE_QUATERNION, q = w, x, y, z."""
        return self.pack(ardupilotmega.MAVLink_attitude_quaternion_message(boot_ms, *q, *rates))

    def gimbal_attitude(self, boot_ms, q, flags=44):
        """GIMBAL_DEVICE_ATTITUDE_STATUS, q = w, x, y, z; 44 is roll and pitch lock, yaw in the vehicle's frame."""
        return self.pack(
            ardupilotmega.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, flags, list(q), math.nan, math.nan, math.nan, 0, gimbal_device_id=1
            )
        )

    def mount_orientation(self, boot_ms, roll, pitch, yaw, yaw_absolute):
        """MOUNT_ORIENTATION; yaw is relative to the nose, yaw_absolute to north."""
        degrees = (math.degrees(angle) for angle in (roll, pitch, yaw, yaw_absolute))
        return self.pack(ardupilotmega.MAVLink_mount_orientation_message(boot_ms, *degrees))

    def camera_information(self, boot_ms, model, focal_length_mm, sensor_mm, size_px):
        """CAMERA_INFORMATION; sensor and image as (width, height)."""
        name = list(model.encode()[:32].ljust(32, b"\0"))
        return self.pack(
            ardupilotmega.MAVLink_camera_information_message(
                boot_ms, [0] * 32, name, 0, focal_length_mm, *sensor_mm, *size_px, 0, 0, 0, b""
            )
        )

    def radio_status(self, rssi, remote_rssi, noise=40, remote_noise=40):
        """RADIO_STATUS."""
        return self.pack(ardupilotmega.MAVLink_radio_status_message(rssi, remote_rssi, 100, noise, remote_noise, 0, 0))


T0 = 1_790_000_000_000_000
"""Unix µs of packet 0."""
FRAMES = [MavlinkEncoder(1 + k % 7).attitude(k, 0.1, 0.2, 0.01 * k) for k in range(50)]


def packet(k, **more):
    """Packet number k, a microsecond after the one before."""
    return Packet(T0 + k, FRAMES[k % len(FRAMES)], **more)


def record(k):
    """Packet number k as a log has it."""
    return struct.pack(">Q", T0 + k) + FRAMES[k % len(FRAMES)]


def records(stop, start=0):
    """A log of the packets of these numbers."""
    return b"".join(map(record, range(start, stop)))


def some_frames(count=200, *, version=2, key=None, system_id=7):
    """Four kinds of messages of one vehicle."""
    speaker = MavlinkEncoder(system_id, version=version, key=key)
    frames = []
    for i in range(count):
        kind = i % 4
        if kind == 0:
            frames.append(speaker.heartbeat())
        elif kind == 1:
            frames.append(speaker.attitude(i * 100, 0.1, -0.2, i * 0.01))
        elif kind == 2:
            frames.append(speaker.global_position_int(i * 100, -35.36, 149.16 + i * 1e-5, 584.0, 0.2, (1, 2, 0), 1.5))
        else:
            frames.append(speaker.statustext(f"Mission: {i} WP"))
    return frames


def heartbeats(count):
    """Of twenty vehicles in turn, each frame another."""
    speakers = [MavlinkEncoder(k + 1) for k in range(20)]
    return [speakers[k % 20].heartbeat(custom_mode=k) for k in range(count)]


EVERY_VERSION = some_frames(40) + some_frames(40, version=1) + some_frames(40, key=b"k" * 32)
"""MAVLink 2, MAVLink 1, signed."""

UAV, UGV = MavlinkEncoder(1), MavlinkEncoder(7)
PARSER = dialect.MAVLink(None)


def message(raw):
    """A frame as pymavlink reads it."""
    (parsed,) = PARSER.parse_buffer(raw)
    return parsed


def packet_of(raw, *, link=0, t_us=1_000_000, auth=Auth.OPEN, peer=1):
    """A frame as it was received."""
    return Packet(t_us, raw, link, peer, auth)
