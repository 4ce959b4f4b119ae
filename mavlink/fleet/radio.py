"""Whose radio link a modem's report is about.

RADIO_STATUS and RADIO come under the id of the vehicle behind the modem, or, from SiK radios, under the modem's own
(51): then they are about the link that they came over, and about each vehicle whose packets come that way.
"""

from __future__ import annotations

from collections.abc import Mapping

from mavlink.fleet.vehicle import Vehicle
from mavlink.protocol.decode import decode
from mavlink.protocol.messages import RadioStatus
from mavlink.protocol.packet import Auth, Packet

MODEM_MESSAGES = (109, 166)
"""RADIO_STATUS and RADIO."""


def add_radio_status(packet: Packet, vehicles: Mapping[int, Vehicle]) -> None:
    """Give a modem's report to the vehicles that it is about.

    Args:
        packet: one of ``MODEM_MESSAGES``.
        vehicles: by system id.
    """
    sample = decode(packet)
    if packet.auth > Auth.GOOD or not isinstance(sample, RadioStatus):
        return
    if packet.system_id in vehicles:
        vehicles[packet.system_id].conditions.add_radio(sample, shared=False)
        return
    channel = packet.link, packet.peer
    behind = [vehicle for vehicle in vehicles.values() if vehicle.conditions.channel == channel]
    for vehicle in behind:
        vehicle.conditions.add_radio(sample, shared=len(behind) > 1)
