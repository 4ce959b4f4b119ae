"""Frames of messages that only tests send."""

import math

from pymavlink.dialects.v20 import ardupilotmega

from mavlink.protocol.encoder import MavlinkEncoder


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
