"""MAVSDK, in one file: it receives only the UAV's packets, and what it sends goes through our own transmitter.

Its `raw://` connection leaves sockets, recording and signing to us. By itself it sends heartbeats and asks every system
it receives for messages, so it is given the UAV's packets alone, and its heartbeats are dropped: ours comes from the
station's loop.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import Any

from gcs.command.ack import CommandAck
from gcs.command.mav_cmd import Command
from mavlink.protocol.framing import split
from mavlink.protocol.packet import Packet

_HEARTBEAT = 0
_REASONS = {"TIMEOUT": "no answer", "NO_SYSTEM": "UAV not received", "CONNECTION_ERROR": "no link to it"}


class MavsdkClient:
    """Commands to one system, one answer each.

    Args:
        uav: its system id.
        own: system and component id that we send as.
        out: given every frame that MAVSDK wants to send but its heartbeats, in a thread of its own.
    """

    def __init__(self, uav: int, own: tuple[int, int], out: Callable[[bytes], object]) -> None:
        # slow to import, and needed only by a station that commands
        from mavsdk import logging
        from mavsdk.mavsdk import Configuration, Mavsdk

        logging.log_subscribe(lambda level, text, file, line: True)  # it would write over the screen
        self._uav = uav
        self._own = own
        self._out = out
        self._direct: Any = None
        self._open = True
        self._lock = threading.Lock()
        self._configuration = Configuration.create_manual(*own, False)
        self._mavsdk = Mavsdk(self._configuration)
        self._mavsdk.add_any_connection("raw://")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._send_frames)

    def receive(self, packet: Packet) -> None:
        """Pass on a packet of the UAV that was accepted; others are left out."""
        if packet.system_id != self._uav:
            return
        with self._lock:
            if self._open:
                self._mavsdk.pass_received_raw_bytes(packet.raw)

    async def send(self, command: Command) -> CommandAck:
        """Send a command, again while nothing comes, and wait for its end."""
        from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectError, MavlinkMessage

        direct = self._direct_to_uav()
        if direct is None:
            return CommandAck(result=None, reason="UAV not received")
        message = MavlinkMessage(command.message, *self._own, self._uav, command.component, command.fields(self._uav))
        try:
            ack = await direct.send_command(message)
        except MavlinkDirectError as error:
            name = str(error.result.name)
            return CommandAck(result=None, reason=_REASONS.get(name, name.lower().replace("_", " ")))
        return CommandAck(result=int(json.loads(ack.fields_json)["result"]))

    def close(self) -> None:
        """Stop MAVSDK; no command may be under way. Packets may still come, and go nowhere."""
        with self._lock:
            self._open = False
        if self._direct is not None:
            self._direct.destroy()
        self._mavsdk.destroy()
        self._configuration.destroy()

    def _direct_to_uav(self) -> Any:  # noqa: ANN401  (MAVSDK's classes carry no types)
        from mavsdk.asyncio import System
        from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync

        if self._direct is None:
            systems = [each for each in self._mavsdk.get_systems() if each.get_system_id() == self._uav]
            self._direct = MavlinkDirectAsync(System(systems[0])) if systems else None
        return self._direct

    def _send_frames(self, data: bytes) -> None:
        for raw in split(data)[0]:
            if Packet(0, raw).message_id != _HEARTBEAT:
                self._out(raw)
