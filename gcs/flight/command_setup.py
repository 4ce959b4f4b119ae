"""The way from an operator's orders to the UAV: its key, its link, and the ground vehicles' places."""

from __future__ import annotations

from collections.abc import Callable

from gcs.command import CommandService, GeoPoint
from gcs.mission.mission import Mission
from gcs.snapshot import Event, Snapshot
from infra.wall_clock import now_us
from mavlink.ingest.ingest import Ingest
from mavlink.links.kinds import kind_of
from mavlink.signing.keys import KeyRing
from mavlink.signing.signer import Signer
from mavlink.transmit.message_rates import uav_rates
from mavlink.transmit.transmitter import Transmitter

FRESH_US = 2_000_000
"""Age of a snapshot or of its telemetry up to which it is current."""


def open_command_service(
    mission: Mission,
    ingest: Ingest,
    ring: KeyRing,
    where: Callable[[int], GeoPoint | None],
    on_event: Callable[[Event], None],
) -> CommandService:
    """The command service of a flight that may command.

    Args:
        mission: who flies.
        ingest: sends.
        ring: frames to a UAV that has a key are signed with it.
        where: the place of a ground vehicle, None when it is not known for sure and now.
        on_event: given what becomes of orders, in another thread.
    """
    uav = mission.uav.system_id
    key = ring.key_of(uav)
    signer = Signer(key) if key is not None else None

    def sign(frame: bytes, link: int) -> bytes:
        assert signer is not None
        return signer.sign(frame, now_us(), link)

    transmitter = Transmitter(
        uav,
        lambda link, peer, raw: ingest.send(link, raw, peer),
        sign=sign if signer else None,
        announce_on=[index for index, name in enumerate(ingest.names) if kind_of(name).waits_to_be_contacted],
    )
    return CommandService(
        uav=uav,
        ground={system_id: mission.name_of(system_id) for system_id in mission.ugv_ids},
        uav_name=mission.name_of(uav),
        transmitter=transmitter,
        where=where,
        on_event=on_event,
        rates=uav_rates(gimbal=mission.follows_gimbal),
        gimbal=mission.camera.gimbal if mission.camera else 0,
    )


def place_of(system_id: int, snapshot: Snapshot | None) -> GeoPoint | None:
    """Place of a vehicle by its own reports, None when they are old, doubted or contested."""
    if snapshot is None or snapshot.origin is None:
        return None
    if now_us() - snapshot.t_us + snapshot.health.behind_s * 1e6 > FRESH_US:
        return None
    for row in snapshot.vehicles:
        if row.system_id == system_id:
            doubted = row.contested or row.doubted_for or system_id in snapshot.conflicts
            if row.position_state != "ok" or doubted:
                return None
            lat_deg, lon_deg, _ = snapshot.origin.to_geodetic(row.p_enu)
            return GeoPoint(float(lat_deg), float(lon_deg))
    return None
