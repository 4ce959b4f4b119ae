"""Troubles of a fleet that is played live, begun and ended while it drives: what an operator practises with."""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from infra.wall_clock import now_us
from sim.errors import PlayError
from sim.world.scenario import UAV_ID

VIDEO, MIRROR, ELSEWHERE = "video", "mirror", "elsewhere"
OF_CAMERAS, OF_THE_FLEET = (VIDEO, MIRROR), (ELSEWHERE,)
"""Troubles of an aircraft's camera, of the first one's without an id, and those of no vehicle alone."""
TROUBLES: Mapping[str, str] = MappingProxyType(
    {
        "battery": "its battery is nearly empty",
        "charge": "its battery is low",
        "link": "its link is lost",
        "loss": "its link loses packets",
        "far": "its link loses most packets",
        "garbled": "what it sends is no MAVLink",
        "impostor": "another sender uses its system id, 80 m away",
        "lie": "it reports to be 30 m from where it is",
        "frozen": "its position stands still",
        "position": "its position does not come",
        "fix": "it has no GPS fix",
        "satellites": "it receives few satellites",
        "filter": "its filter rejects its receiver",
        "compass": "its compass contradicts its motion",
        "attitude": "its attitude does not come",
        "clock": "its date is a minute off",
        "reboot": "it boots again",
        "sensor": "a sensor of it fails",
        "arming": "it cannot be armed",
        "text": "it says that something is wrong",
        "unsigned": "it does not sign",
        "signature": "it signs with another key",
        "stale": "its signatures are five minutes old, and it tells no time",
        VIDEO: "the video stops",
        MIRROR: "the picture is mirrored",
        ELSEWHERE: "no vehicle is where the film shows one",
    }
)
"""Troubles that there are, by name."""
OF_AIRCRAFT = ("attitude",)
"""Troubles that nobody feels of a ground vehicle: nothing is worked out from its attitude."""
OF_SIGNING = ("unsigned", "signature", "stale")
"""Troubles that show only in a fleet that signs."""
STALE_US = 300_000_000
_SIGNING_EPOCH_US = 1_420_070_400_000_000
"""Unix time of 2015-01-01, from which signatures count their time, in 10 µs."""
LOST_SHARES = {"loss": 0.4, "far": 0.75}
LIE_M, IMPOSTOR_M, ELSEWHERE_M = 30.0, 80.0, 40.0
_TURN = 2.4
"""Angle from the direction in which a vehicle is elsewhere to that of the next one, rad: no two are alike."""
_DEGREES7_PER_M = 1e7 / 111_195.0
_SAYS_EVERY = 10
"""Heartbeats between two texts of a vehicle."""
_MAX_BYTES = 64
_GYRO, _ARMING = dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO, dialect.MAV_SYS_STATUS_PREARM_CHECK
_SENSORS = _GYRO | dialect.MAV_SYS_STATUS_SENSOR_GPS | _ARMING
_FILTER_WELL = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
    | dialect.EKF_POS_VERT_ABS
)
_SILENCED = {
    "GLOBAL_POSITION_INT": frozenset({"position"}),
    "ATTITUDE": frozenset({"attitude"}),
    "SYSTEM_TIME": frozenset({"stale"}),
}
"""Troubles by the messages that do not come with them."""
Message = Any
"""The dialect's messages carry no types."""


def parse_trouble(text: str, ids: Sequence[int]) -> tuple[str, int]:
    """A trouble and whose it is, 0 nobody's alone: ``battery 12``, ``video``, ``video 2``, ``elsewhere``.

    Raises:
        ValueError: no such trouble, or no such vehicle.
    """
    name, _, number = text.strip().partition(" ")
    if name not in TROUBLES:
        raise ValueError(f"{name}: is no trouble; there are {', '.join(TROUBLES)}")
    if name in OF_THE_FLEET and not number:
        return name, 0
    if name in OF_CAMERAS and not number:
        return name, UAV_ID
    if not (number.isascii() and number.isdecimal() and int(number) in ids):
        raise ValueError(f"{text}: name one of the vehicles {', '.join(map(str, ids))} behind it")
    return name, int(number)


class Troubles:
    """Sends the messages of a fleet on as they are, or with the troubles that are on. One thread sends.

    Every vehicle sends SYS_STATUS and EKF_STATUS_REPORT beside what it sends anyway.

    Args:
        ids: system ids of the vehicles.
        port: of this computer alone, at which a datagram with a trouble begins or ends it; 0: none.
        keys: 32 bytes to sign with, by system id; without one a vehicle does not sign.

    Raises:
        PlayError: the port cannot be had.
    """

    def __init__(self, ids: Sequence[int], port: int = 0, keys: Mapping[int, bytes] | None = None) -> None:
        self._ids, self._keys = tuple(ids), keys or {}
        self._on: set[tuple[str, int]] = set()
        self._parser = dialect.MAVLink(None)
        self._encoders: dict[tuple[int, int, str], Any] = {}
        self._frozen: dict[tuple[int, str], tuple[int, int]] = {}
        self._boot_ms: dict[int, int] = {}
        """Time that is taken from the boot times of vehicles that booted again."""
        self._beats = dict.fromkeys(self._ids, 0)
        self._driving: set[int] = set()
        """System ids of those that send heartbeats as ground vehicles."""
        self._rng = np.random.default_rng(1)
        self._socket: socket.socket | None = None
        if port:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
            try:
                self._socket.bind(("127.0.0.1", port))
            except OSError as error:
                self._socket.close()
                raise PlayError(f"UDP port {port} cannot be had: {error.strerror}") from error

    def has(self, name: str, system_id: int) -> bool:
        """Tell whether a trouble is on."""
        return (name, system_id) in self._on

    def toggle(self, text: str) -> None:
        """Begin or end a trouble.

        Raises:
            ValueError: no such trouble, or no such vehicle.
        """
        name, system_id = parse_trouble(text, self._ids)
        self._on ^= {(name, system_id)}
        if name == "frozen":
            self._frozen = {whose: place for whose, place in self._frozen.items() if whose[0] != system_id}

    def listen(self) -> None:
        """Take what came to the port; what is no trouble is passed over."""
        if self._socket is None:
            return
        with contextlib.suppress(BlockingIOError):
            while True:
                data = self._socket.recv(_MAX_BYTES)
                with contextlib.suppress(ValueError):  # also of bytes that are no text
                    self.toggle(data.decode())

    def close(self) -> None:
        """Give the port back."""
        if self._socket is not None:
            self._socket.close()

    def frames(self, raw: bytes) -> Iterator[tuple[bool, bytes]]:
        """Frames that are sent in place of a frame: whether by the impostor, and the frame."""
        message = self._parser.decode(bytearray(raw))
        system_id, kind = message.get_srcSystem(), message.get_type()
        on = {name for name, whose in self._on if whose in (0, system_id)}
        if "impostor" in on and kind in ("HEARTBEAT", "GLOBAL_POSITION_INT"):
            forged = self._parser.decode(bytearray(raw))
            if kind == "GLOBAL_POSITION_INT":
                forged.lat += round(IMPOSTOR_M * _DEGREES7_PER_M)
            yield True, self._packed(forged, system_id, message.get_srcComponent(), "impostor")
        messages = [] if on & _SILENCED.get(kind, frozenset()) else [self._changed(message, system_id, on)]
        if kind == "HEARTBEAT":
            self._driving |= {system_id} if message.type == dialect.MAV_TYPE_GROUND_ROVER else set()
            messages += self._beside(system_id, on)
        for each in messages:
            signs = next((name for name in OF_SIGNING if name in on), "")
            frame = self._packed(each, system_id, message.get_srcComponent(), signs)
            share = max((LOST_SHARES[name] for name in on & LOST_SHARES.keys()), default=0.0)
            if "link" not in on and self._rng.random() >= share:
                yield False, frame[::-1] if "garbled" in on else frame

    def _changed(self, message: Message, system_id: int, on: set[str]) -> Message:
        """A message as it is with the troubles of its vehicle."""
        kind = message.get_type()
        if kind in ("GLOBAL_POSITION_INT", "GPS_RAW_INT"):
            self._misplace(message, system_id, on)
        if kind == "GPS_RAW_INT" and on & {"fix", "satellites"}:
            message.fix_type = dialect.GPS_FIX_TYPE_NO_FIX if "fix" in on else message.fix_type
            message.satellites_visible = 4
        if kind == "SYSTEM_TIME" and "clock" in on:
            message.time_unix_usec += 60_000_000
        if hasattr(message, "time_boot_ms"):
            if "reboot" in on:
                self._boot_ms[system_id] = message.time_boot_ms
                self._on.discard(("reboot", system_id))
            message.time_boot_ms = max(message.time_boot_ms - self._boot_ms.get(system_id, 0), 0)
        return message

    def _misplace(self, message: Message, system_id: int, on: set[str]) -> None:
        """Change the place in a message, of the receiver as of the filter: who is misled believes its receiver."""
        whose = system_id, message.get_type()
        place = self._frozen.setdefault(whose, (message.lat, message.lon)) if "frozen" in on else None
        message.lat, message.lon = place or (message.lat, message.lon)
        message.lat += round(LIE_M * _DEGREES7_PER_M) if "lie" in on else 0
        if ELSEWHERE in on and system_id in self._driving:
            message.lat += round(ELSEWHERE_M * math.cos(_TURN * system_id) * _DEGREES7_PER_M)
            message.lon += round(ELSEWHERE_M * math.sin(_TURN * system_id) * _DEGREES7_PER_M)
        if "fix" in on:
            message.lat = message.lon = 0

    def _beside(self, system_id: int, on: set[str]) -> Iterator[Message]:
        """Messages that go with a heartbeat."""
        self._beats[system_id] = self._beats.get(system_id, 0) + 1
        health = _SENSORS & ~(_GYRO * ("sensor" in on)) & ~(_ARMING * ("arming" in on))
        millivolts, percent = (10_100, 7) if "battery" in on else (11_100, 20) if "charge" in on else (12_400, 81)
        yield dialect.MAVLink_sys_status_message(
            *(_SENSORS, _SENSORS, health, 200, millivolts, 500, percent), *([0] * 6)
        )
        refused, turned = (2.0 if name in on else 0.1 for name in ("filter", "compass"))
        yield dialect.MAVLink_ekf_status_report_message(_FILTER_WELL, refused, refused, 0.1, turned, 0.0)
        if "text" in on and self._beats[system_id] % _SAYS_EVERY == 1:
            yield dialect.MAVLink_statustext_message(dialect.MAV_SEVERITY_ERROR, b"Steering: motor does not turn")

    def _packed(self, message: Message, system_id: int, component: int, whose: str) -> bytes:
        """A frame of the vehicle, of the impostor, or signed with a trouble of signing."""
        key = system_id, component, whose
        if key not in self._encoders:
            self._encoders[key] = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component)
            secret = self._keys.get(system_id)
            if secret and whose not in ("impostor", "unsigned"):
                signing = self._encoders[key].signing
                signing.secret_key = secret if whose != "signature" else secret[::-1]
                signing.sign_outgoing = True
        encoder = self._encoders[key]
        ticks = (now_us() - _SIGNING_EPOCH_US - STALE_US * (whose == "stale")) // 10
        encoder.signing.timestamp = max(encoder.signing.timestamp, ticks)
        frame = bytes(message.pack(encoder))
        encoder.seq = (encoder.seq + 1) % 256
        return frame
