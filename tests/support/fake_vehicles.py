"""Vehicles on 127.0.0.1 that answer commands, and a command desk between them. All end by themselves."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.command import CommandParams, CommandService, GeoPoint
from mavlink.geodesy import LocalFrame, quaternion_from_euler, wrap_pi
from mavlink.protocol.encoder import COPTER, ROVER
from mavlink.protocol.packet import Packet
from mavlink.transmit.transmitter import Transmitter
from tests.support.frames import MessageEncoder

MAX_S = 600.0


class FakeVehicle:
    """Beats, reports its position and answers commands; everything it hears is kept."""

    def __init__(self, station: tuple[str, int], system_id: int, *, kind: int = COPTER, mode: int = 4) -> None:
        self.system_id, self.kind, self.mode = system_id, kind, mode
        self.results: dict[int, int] = {}
        """MAV_CMD → MAV_RESULT, accepted for those that are not in it; None: no answer."""
        self.rule: Callable[[Any], int] | None = None
        """In place of the table: result by the command message."""
        self.texts: dict[int, str] = {}
        """MAV_CMD → STATUSTEXT said before the answer."""
        self.progress: dict[int, int] = {}
        """MAV_CMD → percent told in an answer "in progress" before the last."""
        self.place = (47.3977, 8.5456, 520.0, 40.0)
        self.heard: list[Any] = []
        self.bytes_heard = 0
        self._speaker = MessageEncoder(system_id)
        self._parser = dialect.MAVLink(None)
        self._parser.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.02)
        self._station = station
        self._start_s = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def commands(self, number: int | None = None) -> list[Any]:
        """Commands heard, all or those of one number."""
        heard = [said for said in list(self.heard) if said.get_type() in ("COMMAND_LONG", "COMMAND_INT")]
        return [said for said in heard if number is None or said.command == number]

    def order(self, number: int) -> Any:
        """The only command of one number that was heard; who gets no answer in time may have repeated it."""
        said, *repeats = self.commands(number)

        def words(command: Any) -> str:
            return str(command.to_dict() | {"confirmation": 0})

        assert {words(repeat) for repeat in repeats} <= {words(said)}
        return said

    def say(self, message: Any) -> None:
        """Any message of the dialect, as from this vehicle."""
        self._send(MessageEncoder(self.system_id).pack(message))

    def close(self) -> None:
        self._stop.set()
        self._thread.join(60.0)
        self._socket.close()

    def _send(self, raw: bytes) -> None:
        self._socket.sendto(raw, self._station)

    def _run(self) -> None:
        due_s = 0.0
        while not self._stop.is_set() and time.monotonic() - self._start_s < MAX_S:
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + 0.1
                self._report()
            try:
                data = self._socket.recv(4096)
            except TimeoutError:
                continue
            self.bytes_heard += len(data)
            for said in self._parser.parse_buffer(data) or []:
                self.heard.append(said)
                if said.get_type() in ("COMMAND_LONG", "COMMAND_INT") and said.target_system == self.system_id:
                    self._answer(said)

    def _report(self) -> None:
        boot_ms = round((time.monotonic() - self._start_s) * 1e3)
        self._send(self._speaker.heartbeat(self.kind, custom_mode=self.mode))
        lat, lon, alt, relative = self.place
        self._send(self._speaker.global_position_int(boot_ms, lat, lon, alt, relative))

    def _answer(self, said: Any) -> None:
        number = said.command
        if number in self.texts:
            self._send(self._speaker.statustext(self.texts[number]))
        if number in self.progress:
            self._ack(said, 5, self.progress[number])
        result = self.rule(said) if self.rule is not None else self.results.get(number, 0)
        if result is not None:
            self._ack(said, result, 0)
            self._obey(said, result)

    def _obey(self, said: Any, result: int) -> None:
        if result == 0 and said.command == 176:
            self.mode = int(said.param2)
        if result == 0 and said.command == 192 and int(said.param2) & 1:
            self.mode = 4

    def _ack(self, said: Any, result: int, progress: int) -> None:
        who = (said.get_srcSystem(), said.get_srcComponent())
        self._send(self._speaker.pack(dialect.MAVLink_command_ack_message(said.command, result, progress, 0, *who)))


class Socket:
    """A station's side: one UDP port for everybody, peers numbered as they come; poll it to make time pass."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.address: tuple[str, int] = self.socket.getsockname()
        self._peers: dict[tuple[str, int], int] = {}
        self.sent: list[bytes] = []

    def send(self, link: int, peer: int, raw: bytes) -> None:
        address = next(address for address, number in self._peers.items() if number == peer)
        self.sent.append(raw)
        self.socket.sendto(raw, address)

    def packets(self) -> list[Packet]:
        got = []
        while True:
            try:
                raw, sender = self.socket.recvfrom(4096)
            except BlockingIOError:
                return got
            peer = self._peers.setdefault(sender, len(self._peers) + 1)
            got.append(Packet(time.time_ns() // 1000, raw, 0, peer))

    def close(self) -> None:
        self.socket.close()


def rover(station: tuple[str, int], system_id: int) -> FakeVehicle:
    """A ground vehicle."""
    return FakeVehicle(station, system_id, kind=ROVER)


_GIMBAL = 285
_ROI_LOCATION, _ROI_NONE, _ROI_SYSTEM = 195, 197, 198
_PITCHYAW, _MOUNT_CONTROL, _INTERVAL = 1000, 205, 511
SLEW = math.radians(240.0)
"""Per second: quicker than any, so that tests are short."""


class FakeCopter(FakeVehicle):
    """Accepts DO_SET_ROI_SYSID and does nothing, as it hears nobody; turns for a place and for angles.

    Attributes:
        hears: places of vehicles whose positions it hears itself, by system id.
        obeys: commands that turn its gimbal; all are accepted.
        has_gimbal: whether it reports one when asked.
        stays_deaf: whether requests for reports are denied.
    """

    def __init__(self, station: tuple[str, int], system_id: int, *, nose: float = 0.5, pitch: float = 0.0) -> None:
        self.hears: dict[int, tuple[float, float, float]] = {}
        self.obeys = {_ROI_LOCATION, _PITCHYAW, _MOUNT_CONTROL, _ROI_SYSTEM}
        self.has_gimbal = True
        self.nose, self.pitch, self.yaw = nose, pitch, nose
        self._goal: Any = None
        self._asked = False
        self._turned_s = time.monotonic()
        super().__init__(station, system_id)

    def _obey(self, said: Any, result: int) -> None:
        super()._obey(said, result)
        if result:
            return
        if said.command == _INTERVAL and said.param1 == _GIMBAL:
            self._asked = True
        if said.command not in self.obeys:
            return
        if said.command == _ROI_LOCATION:
            self._goal = (said.x * 1e-7, said.y * 1e-7, said.z)
        elif said.command == _ROI_SYSTEM:
            self._goal = int(said.param1)
        elif said.command == _PITCHYAW and not math.isnan(said.param1):
            assert int(said.param5) & 16, "yaw from north"
            self._goal = (math.radians(said.param1), math.radians(said.param2))
        elif said.command == _MOUNT_CONTROL and said.param7 == 2:
            self._goal = (math.radians(said.param1), wrap_pi(math.radians(said.param3) + self.nose))

    def _angles(self) -> tuple[float, float] | None:
        """Pitch and yaw that it turns to."""
        goal = self.hears.get(self._goal) if isinstance(self._goal, int) else self._goal
        if goal is None or len(goal) == 2:
            return goal
        lat, lon, alt, _ = self.place
        east, north, up = LocalFrame(lat, lon, alt).to_enu_point(*goal)
        return math.atan2(up, math.hypot(east, north)), math.atan2(east, north)

    def _report(self) -> None:
        super()._report()
        now_s = time.monotonic()
        boot_ms, turn = round((now_s - self._start_s) * 1e3), SLEW * (now_s - self._turned_s)
        self._turned_s = now_s
        if (angles := self._angles()) is not None:
            self.pitch += max(-turn, min(turn, angles[0] - self.pitch))
            self.yaw += max(-turn, min(turn, wrap_pi(angles[1] - self.yaw)))
        self._send(self._speaker.attitude(boot_ms, 0.0, 0.0, self.nose))
        if self._asked and self.has_gimbal:
            q = quaternion_from_euler(0.0, self.pitch, wrap_pi(self.yaw - self.nose))
            self._send(self._speaker.gimbal_attitude(boot_ms, q))


UAV, UGV, OTHER = 1, 3, 4
PLACE = GeoPoint(47.3980, 8.5460)


def open_air(make_uav, params: CommandParams) -> SimpleNamespace:
    """The desk, the vehicles, and ways to order and to wait; ``close`` ends all.

    Args:
        make_uav: a vehicle for a station's address and a system id.
        params: how orders are carried out.
    """
    sock = Socket()
    uav, ugvs = make_uav(sock.address, UAV), [rover(sock.address, UGV), rover(sock.address, OTHER)]
    events, recorded, places = [], [], {UGV: PLACE}
    transmitter = Transmitter(UAV, sock.send, sent=lambda link, raw: recorded.append(raw))
    desk = CommandService(
        uav=UAV,
        ground={UGV: "UGV-3", OTHER: "UGV-4"},
        uav_name="UAV-1",
        transmitter=transmitter,
        where=places.get,
        on_event=events.append,
        params=params,
    )

    def until(done, seconds=60.0):
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            for packet in sock.packets():
                desk.receive(packet)
            desk.poll()
            if done():
                return True
            time.sleep(0.005)
        return False

    def order(key, about=0, words=""):
        """Gives an order and waits for an event with some words; the events up to it."""
        before = len(events)
        desk.submit(key, about)

        def told():
            later = [event for event in events[before:] if "ordered" not in event.text]
            found = next((k for k, event in enumerate(later) if words in event.text), None)
            return later[: found + 1] if found is not None else []

        assert until(told), [event.text for event in events]
        return told()

    def close():
        desk.close()
        for vehicle in (uav, *ugvs):
            vehicle.close()
        sock.close()
        assert [vehicle.bytes_heard for vehicle in ugvs] == [0, 0], "nothing is ever sent to a ground vehicle"
        assert all(said.get_srcSystem() == 254 and said.get_srcComponent() == 190 for said in uav.heard)

    assert until(lambda: desk._mavsdk._direct_to_uav() is not None and desk._uav.alt_m > 0)
    return SimpleNamespace(
        uav=uav,
        ugvs=ugvs,
        desk=desk,
        events=events,
        recorded=recorded,
        places=places,
        until=until,
        order=order,
        sock=sock,
        transmitter=transmitter,
        close=close,
    )
