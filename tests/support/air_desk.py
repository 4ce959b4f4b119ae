"""A command desk between a UAV and two ground vehicles that must never hear a thing."""

from __future__ import annotations

import time
from types import SimpleNamespace

from gcs.command import CommandParams, CommandService, GeoPoint
from mavlink.transmit.transmitter import Transmitter
from tests.support.fake_autopilot import Socket, rover

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
        tell=events.append,
        params=params,
    )

    def until(done, seconds=30.0):
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
        """Gives an order and waits for an event with some words."""
        before = len(events)
        desk.submit(key, about)
        assert until(lambda: any(words in event.text for event in events[before:] if "ordered" not in event.text)), [
            event.text for event in events
        ]
        return [event for event in events[before:] if "ordered" not in event.text]

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
