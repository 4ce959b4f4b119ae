"""Floods: from unknown addresses, with junk in a vehicle's name beside it, and of valid frames under a known id."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Sequence

from bench.attacks.actors import rover, uav, vehicle_schedules
from bench.attacks.records import first_warning
from bench.attacks.report import AttackRow
from bench.attacks.run import Flown, Options, fly
from bench.attacks.stage import FALSE, TRUE, Flood, PacketSchedule, Party, SenderFactory, Stage
from bench.attacks.wire import ComponentEncoder, ticks_now
from bench.station import FlyingStation, key_of, write_keys

UNKNOWN_SENDER = 0
"""System id under which packets without one are counted."""
BEGIN_S = 4.0
"""Start of the flood: the station has learnt the vehicles by then."""
FLOOD_HZ, JUNK_HZ, PADDING_HZ = 30_000.0, 2_000.0, 200.0
"""Datagrams a second: of unknown senders, of junk from a vehicle's address, and of further traffic of each vehicle."""
KNOWN_HZ, FLEET_HZ = 60_000.0, 2_400.0
"""Datagrams a second under the known id, and of the whole fleet."""
UNLIMITED = 1 << 40
"""Count of a flood's datagram: it is sent and may be recorded any number of times."""
FLEET = 20
"""Vehicles, the UAV included."""
PORTS = 300
"""Source ports of a flood: more senders than the station admits."""
FLOODED = r"flood|too many|limit|barred|turned away|more than"
"""Words in messages about a flood, or about an address that is limited."""
ALARM_WITHIN_S = 5.0
"""An alarm later than this after the flood began counts as missed."""
FAIR_SHARE = 0.5
"""A vehicle whose id is flooded keeps at least this share of its packets: it is one of two senders."""


def _padding(encoder: ComponentEncoder) -> Callable[[float], list[bytes]]:
    """Further packets of a vehicle, each with another value so that they can be counted."""
    numbers = itertools.count()
    return lambda t_s: [encoder.parameter(next(numbers))]


def _random_payload(size: int) -> Callable[[float], list[bytes]]:
    """Datagrams of random bytes."""
    rng = random.Random(3)
    return lambda t_s: [rng.randbytes(size)]


def _junk() -> list[bytes]:
    """Mostly frames with a wrong checksum, which cannot be distinguished from good ones before they are read."""
    rng = random.Random(7)
    forged = bytearray(ComponentEncoder(201).heartbeat())
    forged[-1] ^= 1
    return [each for k in range(64) for each in (b"\xfd\xff\x00", rng.randbytes(1 + k * 3), *[bytes(forged)] * 4)]


def _lost(flown: Flown, ids: Sequence[int]) -> int:
    """True packets of these ids that were sent and not recorded."""
    return sum(flown.sent.count[TRUE, i] - flown.recorded[TRUE, i] for i in ids)


def _flooded(
    options: Options,
    name: str,
    ids: Sequence[int],
    lines: Callable[..., list[PacketSchedule]],
    party: Party,
    rate_hz: float,
    senders: int,
    datagrams: Sequence[bytes],
    keys: str = "none",
) -> Flown:
    """A flight with a flood from :data:`BEGIN_S` until just before its end."""
    length_s = 12.0 if options.quick else 20.0

    def during(station: FlyingStation, stage: Stage) -> None:
        stage.wait(BEGIN_S)
        for raw in datagrams:
            stage.sent.owners[raw][party] = UNLIMITED
        flood = Flood(station.ports[0], rate_hz * options.rate, senders, datagrams)
        stage.sent.first_s[party] = stage.now_s
        try:
            stage.wait(length_s - 1.0)
        finally:
            stage.sent.count[party] = flood.end()

    return fly(options, name, ids, lines, length_s, keys=keys, during=during)


def spoofed_junk(options: Options) -> list[AttackRow]:
    """Junk of 8 bytes from a vehicle's own address and port, beside a flood from elsewhere; without and with keys."""
    return [_spoofed(options, signed) for signed in (False, True)]


def _spoofed(options: Options, signed: bool) -> AttackRow:
    ids = (11, 12, 13)
    keys = write_keys(options.folder / "keys-junk", (1, *ids)) if signed else "none"

    def encoder_of(system_id: int) -> ComponentEncoder:
        return (
            ComponentEncoder(system_id, key=key_of(system_id), stamp=ticks_now())
            if signed
            else ComponentEncoder(system_id)
        )

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), encoder_of(1), new_sender())
        for system_id in ids:
            encoder, send = encoder_of(system_id), new_sender()
            found += vehicle_schedules(rover(system_id), encoder, send)
            found.append(PacketSchedule(party=(TRUE, system_id), make=_padding(encoder), send=send, rate_hz=PADDING_HZ))
            if system_id == ids[0]:
                found.append(
                    PacketSchedule(
                        party=(FALSE, system_id), make=_random_payload(8), send=send, rate_hz=JUNK_HZ, start_s=BEGIN_S
                    )
                )
        return found

    flown = _flooded(
        options, f"junk-{signed}", ids, lines, (FALSE, UNKNOWN_SENDER), FLOOD_HZ, 1, _junk(), keys=str(keys)
    )
    others = _lost(flown, ids[1:])
    silent = first_warning(flown.events, "no heartbeat")
    limited = first_warning(flown.events, FLOODED)
    counts = flown.counts(ids[0])
    notes = [f"{others} of others lost"] * bool(others) + ([f"false: {silent.text}"] if silent else [])
    notes += [] if limited else ["no alarm"]
    return AttackRow(
        attack="spoofed junk",
        case="with keys" if signed else "without keys",
        **counts | {"false_sent": counts["false_sent"] + flown.sent.count[FALSE, UNKNOWN_SENDER]},
        alarm_s=max(limited.t_s - flown.sent.first_s[FALSE, UNKNOWN_SENDER], 0.0) if limited else float("nan"),
        held=not counts["lost"] and not others and silent is None,
        note="; ".join(notes),
    )


def known_id(options: Options) -> list[AttackRow]:
    """Valid frames of a vehicle's id in a flood, from 300 ports and from one, beside a fleet of 2,400 packets/s."""
    return [_known(options, ports) for ports in (PORTS, 1)]


def _known(options: Options, ports: int) -> AttackRow:
    ids = [11 + k for k in range(FLEET - 1)]

    def lines(new_sender: SenderFactory) -> list[PacketSchedule]:
        found = vehicle_schedules(uav(), ComponentEncoder(1), new_sender())
        for system_id in ids:
            encoder, send = ComponentEncoder(system_id), new_sender()
            found += vehicle_schedules(rover(system_id), encoder, send)
            found.append(
                PacketSchedule(
                    party=(TRUE, system_id),
                    make=_padding(encoder),
                    send=send,
                    rate_hz=FLEET_HZ * options.rate / len(ids),
                )
            )
        return found

    false = ComponentEncoder(ids[0])
    frames = [false.parameter(-1.0 - k) for k in range(256)]
    flown = _flooded(options, f"known-id-{ports}", ids, lines, (FALSE, ids[0]), KNOWN_HZ, ports, frames)
    others = _lost(flown, ids[1:])
    counts = flown.counts(ids[0])
    share = 1.0 - counts["lost"] / max(counts["sent"], 1)
    alarm = first_warning(flown.events, FLOODED, since_s=BEGIN_S)
    over = [event for event in flown.events if "over" in event.text and "flood" in event.text]
    early = [event for event in over if event.t_s < flown.flown_s - 1.5]
    notes = [f"{others} of the {len(ids) - 1} others lost", f"{share:.0%} of the imitated one kept"]
    notes += [] if alarm else ["no alarm"]
    notes += [f"said to be over after {early[0].t_s - BEGIN_S:.0f} s"] if early else []
    notes += [f"sender {flown.sent.late_s:.1f} s late"] if flown.sent.late_s > 0.5 else []
    begun_s = flown.sent.first_s[FALSE, ids[0]]
    alarm_s = alarm.t_s - begun_s if alarm else float("nan")
    return AttackRow(
        attack="flood of a known id",
        case=f"from {ports} ports" if ports > 1 else "from one port",
        **counts,
        alarm_s=alarm_s,
        held=not others and share >= FAIR_SHARE and alarm_s <= ALARM_WITHIN_S and not early,
        note="; ".join(notes),
    )
