"""Conflicts of two senders over one system id.

A vehicle has one kind, one mode, one clock, one place, one attitude and one hardware id at a time. Places are compared
by :mod:`mavlink.duplicate_id.claimed_places`, attitudes by :class:`AttitudeComparison`. In all else
a second sender alternates with the vehicle, and that is what is looked for: contradictions whose sender changes again
and again. A reboot, a new address or a late copy changes once or for an instant, and is no conflict; a receiver that
jumps has one sender.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from infra.reporting import Throttle
from mavlink.duplicate_id.autopilot_id import HardwareId, hardware_id_of
from mavlink.duplicate_id.claimed_places import ClaimedPlaces
from mavlink.duplicate_id.sender_path import MAX_LINK_LAG_US, same_channel
from mavlink.estimation.interpolation import Pose
from mavlink.estimation.positions import VehicleLimits
from mavlink.geodesy import wrap_pi
from mavlink.protocol.messages import Attitude, GlobalPosition, Heartbeat
from mavlink.protocol.modes import kind_name, mode_name
from mavlink.protocol.packet import Packet
from mavlink.reception.reception import SenderKey
from mavlink.reception.rejected_packets import REPORT_AGAIN_US
from mavlink.state import Level

_MAX_SENDERS = 8
"""Senders compared; a flood of addresses must cost neither memory nor time."""
_GAP, _GAP_RATE = math.radians(10.0), math.radians(60.0)
"""Greatest difference of two attitudes of one vehicle, rad, and that per second between them."""
_ATTITUDES_TOGETHER_US = 300_000
"""Attitudes this close in time are compared."""
ConflictKind = Literal["autopilot", "kind", "mode", "clock", "boot", "place", "attitude", "hardware"]
_PAUSE_US = 3_000_000
"""Contradictions farther apart than this do not belong together."""
_SPAN_US = 900_000
"""Least time for which senders have to alternate: a vehicle that restarts does so once."""
_ALTERNATIONS: dict[ConflictKind, int] = {
    "autopilot": 3,
    "kind": 3,
    "mode": 4,
    "clock": 3,
    "boot": 3,
    "attitude": 3,
}
"""Number of times that they have to; a mode more often, since an operator may switch there and back."""
_HOLD_US = 4_500_000
"""Time that a conflict lasts after the last contradiction: longer than the longest pause between contradictions of two
senders that send heartbeats once a second and lose packets."""
_HOLD_HARDWARE_US = 60_000_000
"""Equivalent of ``_HOLD_US`` after two hardware ids, which are sent rarely."""
_TOGETHER_US = 3_000_000
"""Senders seen within this are seen together: three heartbeats."""
_LEADS_US = 2_000_000
"""Positions come once a second, and after this long they show whether a link is faster or a clock another's."""
_BOOT_US = 500_000
"""An autopilot's Unix time and boot time keep step to a millisecond, once it has GPS time; this is far more."""
_ADDRESS_CHANGES = 4
"""Changes of the address after which two addresses are reported."""
_ADDRESSES_US = 600_000_000
"""Interval between reports of two addresses: two radios into one port last a whole flight."""
_MAX_KINDS = 8
"""Kinds of vehicle remembered, so that a flood of forged heartbeats costs no memory."""
_USUAL_CLOCK, _OTHER_CLOCK = "usual", "other"
_NO_SENDER = SenderKey(-1, 0, 0)


class AttitudeConflict(NamedTuple):
    """Another sender whose attitude contradicts this one's."""

    other: SenderKey
    gap: float
    """Radians."""


class AttitudeComparison:
    """The newest attitude of each sender."""

    def __init__(self) -> None:
        self._newest: dict[SenderKey, tuple[int, int, Attitude]] = {}

    def add(self, sender: SenderKey, boot_us: int, sample: Attitude) -> AttitudeConflict | None:
        """Keep an attitude and compare it with those of others a moment ago."""
        self._newest.pop(sender, None)
        conflict = None
        for other, (other_us, t_us, newest) in self._newest.items():
            if abs(sample.t_us - t_us) < _ATTITUDES_TOGETHER_US and abs(boot_us - other_us) < _ATTITUDES_TOGETHER_US:
                dt_s = abs(boot_us - other_us) * 1e-6
                if turned_too_far(sample, newest, dt_s):
                    conflict = AttitudeConflict(other, _largest_difference(sample, newest))
        if len(self._newest) >= _MAX_SENDERS:
            del self._newest[next(iter(self._newest))]
        self._newest[sender] = (boot_us, sample.t_us, sample)
        return conflict


def turned_too_far(one: Attitude | Pose, other: Attitude | Pose, dt_s: float) -> bool:
    """Tell whether no vehicle turns this far in this time."""
    return _largest_difference(one, other) > _GAP + _GAP_RATE * dt_s


def _largest_difference(one: Attitude | Pose, other: Attitude | Pose) -> float:
    """Radians, of the angle that differs most."""
    return max(
        abs(wrap_pi(one.roll - other.roll)), abs(wrap_pi(one.pitch - other.pitch)), abs(wrap_pi(one.yaw - other.yaw))
    )


@dataclass(frozen=True, slots=True)
class IdConflict:
    """Contradiction of two senders of one system id, and where they were received."""

    kind: ConflictKind
    detail: str
    one: SenderKey
    other: SenderKey


class _Alternation:
    """Two sides that alternate: how often the side has changed, without a longer pause, and for how long."""

    __slots__ = ("_changes", "_first_us", "_last_us", "_side", "other", "sender")

    def __init__(self) -> None:
        self.sender = self.other = _NO_SENDER
        """The side that was received last, and the one before."""
        self._side: Hashable = None
        self._changes = 0
        self._first_us = self._last_us = 0

    def add(self, side: Hashable, sender: SenderKey, other: SenderKey, t_us: int) -> bool:
        """Add one packet; True when its side is another than before.

        Args:
            other: of the other side's last packet.
            t_us: Unix µs of its arrival.
        """
        if not self._changes or not self.is_running(t_us):
            self._changes, self._first_us = 1, t_us
        elif side == self._side:
            return False
        else:
            self._changes += 1
        self._side, self.sender, self.other, self._last_us = side, sender, other, t_us
        return True

    def is_running(self, t_us: int) -> bool:
        """Tell whether the last change of sides was in the last seconds."""
        return self._changes > 0 and 0 <= t_us - self._last_us < _PAUSE_US

    def is_established(self, changes: int, t_us: int) -> bool:
        """Tell whether there were this many changes, over about a second."""
        return self._changes >= changes and self.is_running(t_us) and self._last_us - self._first_us >= _SPAN_US


class _Conflicts:
    """Collects contradictions; a conflict lasts for some seconds after the last one (a minute for hardware ids)."""

    def __init__(self) -> None:
        self.newest: IdConflict | None = None
        self._alternations: dict[ConflictKind, _Alternation] = {}
        self._last_us = 0
        self._hold_us = 0

    def is_active(self, t_us: int) -> bool:
        """Tell whether two senders use the id at a Unix time in µs."""
        return abs(t_us - self._last_us) < self._hold_us

    def is_running(self, kind: ConflictKind, t_us: int) -> bool:
        """Tell whether there was a contradiction in the last seconds, so that packets of the usual side count too."""
        alternation = self._alternations.get(kind)
        return alternation is not None and alternation.is_running(t_us)

    def add(
        self, kind: ConflictKind, side: Hashable, sender: SenderKey, t_us: int, detail: str, other: SenderKey
    ) -> None:
        """Add one contradiction.

        Args:
            side: which of the two sides this packet is of.
            t_us: Unix µs of its arrival.
            other: of the other side's last packet.
        """
        alternation = self._alternations.setdefault(kind, _Alternation())
        if alternation.add(side, sender, other, t_us) and alternation.is_established(_ALTERNATIONS[kind], t_us):
            self.declare(kind, detail, sender, alternation.other, t_us)

    def declare(self, kind: ConflictKind, detail: str, one: SenderKey, other: SenderKey, t_us: int) -> None:
        """Note that there are two senders for certain."""
        if not self.is_active(t_us):
            self.newest = IdConflict(kind, detail, one, other)
        hold_us = _HOLD_HARDWARE_US if kind == "hardware" else _HOLD_US
        if t_us + hold_us > self._last_us + self._hold_us or not self.is_active(t_us):
            self._last_us, self._hold_us = t_us, hold_us


class DuplicateIdDetector:
    """Compares what the senders of one system id report.

    Args:
        links: names of the links by index, for messages to the operator.
        address: of a link's index and a peer's number, in words; empty where it is not known.
    """

    def __init__(
        self,
        limits: VehicleLimits,
        *,
        drives: bool,
        links: tuple[str, ...] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
    ) -> None:
        self.reports = Throttle(REPORT_AGAIN_US)
        self._address_reports = Throttle(_ADDRESSES_US)
        self.hardware_text = ""
        """Hardware id in hexadecimal, empty until reported."""
        self._links, self._address = links, address
        self._conflicts = _Conflicts()
        self._reported_conflict = False
        self._places = ClaimedPlaces(limits, drives=drives)
        self._attitudes = AttitudeComparison()
        self._kinds: dict[tuple[int, int], tuple[int, SenderKey]] = {}
        self._kind: tuple[int, int] | None = None
        self._heartbeat: tuple[Heartbeat, SenderKey] | None = None
        self._boot: tuple[int, int, SenderKey] | None = None
        self._hardware: tuple[HardwareId, int, SenderKey] | None = None
        self._sender = _NO_SENDER
        self._changed_us = 0
        self._addresses = _Alternation()
        self._usual_clock = self._other_clock = self._sender
        self._leading = (self._sender, 0)
        self._autopilot: SenderKey | None = None

    def add_sender(self, sender: SenderKey, t_us: int) -> None:
        """Note who sent a packet."""
        before = self._sender
        if sender == before:
            return
        self._sender = sender
        if before.link < 0:
            return
        self._changed_us = t_us
        if before.link == sender.link and before.peer != sender.peer:
            self._addresses.add(sender.peer, sender, before, t_us)

    def several_senders(self, t_us: int) -> bool:
        """Tell whether more than one sender was received in the last seconds: two radios, or two vehicles."""
        return abs(t_us - self._changed_us) < _TOGETHER_US

    def in_conflict(self, t_us: int) -> bool:
        """Tell whether two senders contradict each other."""
        return self._conflicts.is_active(t_us)

    def compare_kind(self, sample: Heartbeat, sender: SenderKey) -> tuple[str, str] | None:
        """Compare the kind of vehicle with those reported before; the last and this in words when they differ."""
        kind, before = (sample.type, sample.autopilot), self._kind
        self._kind = kind
        self._kinds.pop(kind, None)
        self._kinds[kind] = (sample.t_us, sender)
        if len(self._kinds) > _MAX_KINDS:
            del self._kinds[next(iter(self._kinds))]
        if len(self._kinds) > 1:
            self._compare_with_recent_kinds(kind, sender, sample.t_us)
        if before is None or kind_name(before[0]) == kind_name(kind[0]):
            return None
        return kind_name(before[0]), kind_name(kind[0])

    def compare_mode(self, sample: Heartbeat, sender: SenderKey) -> None:
        """Compare armed and mode with those of another sender: who changes them changes them on all its radios."""
        before, self._heartbeat = self._heartbeat, (sample, sender)
        if before is None or before[1] == sender or not abs(sample.t_us - before[0].t_us) < _TOGETHER_US:
            return
        one, other = _mode_text(before[0]), _mode_text(sample)
        if one != other:
            self._conflicts.add("mode", sender, sender, sample.t_us, f"{one} and {other}", before[1])

    def compare_boot_time(self, t_us: int, sender: SenderKey, booted_us: int) -> None:
        """Compare when the vehicle was switched on, by its own Unix time: no delay of a link changes that."""
        before, self._boot = self._boot, (booted_us, t_us, sender)
        if before is None or not abs(t_us - before[1]) < _TOGETHER_US or abs(booted_us - before[0]) < _BOOT_US:
            return
        detail = f"two vehicles, switched on {abs(booted_us - before[0]) * 1e-6:.1f} s apart"
        self._conflicts.add("boot", booted_us > before[0], sender, t_us, detail, before[2])

    def add_other_clock(self, t_us: int, sender: SenderKey, gap_s: float) -> None:
        """Add a boot time that fits neither this vehicle's clock nor the one before its reboot.

        Args:
            t_us: Unix µs of its arrival.
            gap_s: how much later the message came than its boot time allows; negative when it came earlier.
        """
        if -MAX_LINK_LAG_US <= gap_s * 1e6 < 0 and not self._stays_ahead(sender, t_us):
            return
        self._other_clock = sender
        detail = f"two clocks, {abs(gap_s):.0f} s apart"
        self._conflicts.add("clock", _OTHER_CLOCK, sender, t_us, detail, self._usual_clock)

    def _stays_ahead(self, sender: SenderKey, t_us: int) -> bool:
        """Tell whether a sender that is seconds ahead has another's clock, not this vehicle's over a faster link."""
        if self._places.is_reporting(sender, t_us):
            return False  # its places decide
        if self._leading[0] != sender:
            self._leading = (sender, t_us)
        return t_us - self._leading[1] >= _LEADS_US

    def add_usual_clock(self, t_us: int, sender: SenderKey) -> None:
        """Add a boot time that fits."""
        self._usual_clock = sender
        if self._conflicts.is_running("clock", t_us):
            self._conflicts.add("clock", _USUAL_CLOCK, sender, t_us, "two clocks", self._other_clock)

    def compare_place(self, sample: GlobalPosition, sender: SenderKey, std_m: float) -> None:
        """Compare a place, of any component, with those of other senders."""
        conflict = self._places.add(sender, sample, std_m)
        if conflict:
            detail = f"two places, {conflict.gap_m:.0f} m apart"
            self._conflicts.declare("place", detail, sender, conflict.other, sample.t_us)

    def is_faster_link(self, sender: SenderKey, t_us: int) -> bool:
        """Tell whether a sender is the same vehicle over a faster link, or the only one that reports a place."""
        if self._places.is_faster_link(sender):
            return True
        return not same_channel(sender, self._usual_clock) and self._places.is_only_one(sender, t_us)

    def is_slower_link(self, sender: SenderKey) -> bool:
        """Tell whether a sender is the same vehicle over a slower link."""
        return self._places.is_slower_link(sender)

    def compare_autopilots(self, t_us: int, sender: SenderKey, rival: int) -> None:
        """Compare two components that send an autopilot's heartbeat while only the one that is not in use reports.

        Args:
            t_us: Unix µs of the heartbeat.
            rival: id of the one that reports, negative for none.
        """
        before, self._autopilot = self._autopilot, sender
        sides = (before.component, sender.component) if before is not None else ()
        if before is not None and rival in sides and sender.component != before.component:
            detail = "two autopilots, and the other than before reports a position"
            self._conflicts.add("autopilot", sender.component, sender, t_us, detail, before)

    def compare_attitude(self, boot_us: int, sample: Attitude, sender: SenderKey) -> None:
        """Compare an attitude with those of other senders."""
        conflict = self._attitudes.add(sender, boot_us, sample)
        if conflict:
            detail = f"two attitudes, {math.degrees(conflict.gap):.0f}° apart"
            self._conflicts.add("attitude", sender, sender, sample.t_us, detail, conflict.other)

    def compare_late_attitude(self, sample: Attitude, sender: SenderKey, then: Pose | None) -> None:
        """Compare an attitude that came late with the one that the vehicle reported for that time."""
        if then is not None and then.bracketed and turned_too_far(sample, then, then.age_s):
            self._other_clock = sender
            detail = "two clocks and two attitudes"
            self._conflicts.add("clock", _OTHER_CLOCK, sender, sample.t_us, detail, self._usual_clock)

    def compare_hardware(self, packet: Packet, sender: SenderKey, epoch: int) -> str:
        """Compare the hardware id with the one before; return what to report when the board was changed."""
        hardware, known = hardware_id_of(packet), self._hardware
        if not hardware.text:
            return ""
        if known is None or not known[0].differs(hardware):
            self._hardware = (hardware, epoch, sender)
            self.hardware_text = hardware.text
            return ""
        if known[1] != epoch:
            self._hardware, self.hardware_text = (hardware, epoch, sender), hardware.text
            return f"is another autopilot since it has rebooted (hardware id {hardware.text})"
        detail = f"two autopilots, hardware id {known[0].text} and {hardware.text}"
        self._conflicts.declare("hardware", detail, sender, known[2], packet.t_us)
        return ""

    def report(self, t_us: int, system_id: int) -> tuple[Level, str]:
        """Return the news for the operator since the last call; an empty text for nothing."""
        active = self._conflicts.is_active(t_us)
        if active == self._reported_conflict:
            return ("info", "") if active else ("warning", self._two_addresses_text(t_us, system_id))
        self._reported_conflict = active
        if not active:
            return "info", f"system id {system_id} has one sender again: {self.channel_text(self._sender)}"
        conflict = self._conflicts.newest
        assert conflict is not None
        text = f"two senders use system id {system_id}: its positions are not used; {self._conflict_text(conflict)}"
        return "alarm", text

    def _two_addresses_text(self, t_us: int, system_id: int) -> str:
        """A second radio into one port looks like this, and so does a forger who agrees: reported, not rejected."""
        found = self._addresses
        if not found.is_established(_ADDRESS_CHANGES, t_us) or not self._address_reports.due("addresses", t_us):
            return ""
        other, one = self.channel_text(found.other), self.channel_text(found.sender)
        return f"system {system_id} sends from two addresses ({other} and {one})"

    def channel_text(self, sender: SenderKey) -> str:
        """A channel in words, without the component."""
        name = self._links[sender.link] if 0 <= sender.link < len(self._links) else f"link {sender.link}"
        address = self._address(sender.link, sender.peer) if sender.peer else ""
        if address:
            return f"{address} on {name}"
        return f"{name} address {sender.peer}" if sender.peer else name

    def _conflict_text(self, conflict: IdConflict) -> str:
        one, other = self.channel_text(conflict.other), self.channel_text(conflict.one)
        components = conflict.other.component, conflict.one.component
        if components[0] != components[1]:
            return f"{conflict.detail}: component {components[0]} at {one} and component {components[1]} at {other}"
        return f"{conflict.detail}: {one} and {other}" if one != other else f"{conflict.detail}: both on {one}"

    def _compare_with_recent_kinds(self, kind: tuple[int, int], sender: SenderKey, t_us: int) -> None:
        for other in list(self._kinds):
            seen_us, other_sender = self._kinds[other]
            if not abs(t_us - seen_us) < _TOGETHER_US:
                del self._kinds[other]
            elif other != kind:
                names = f"a {kind_name(other[0])} and a {kind_name(kind[0])}"
                if kind_name(other[0]) == kind_name(kind[0]):
                    names = f"type {other[0]} autopilot {other[1]} and type {kind[0]} autopilot {kind[1]}"
                self._conflicts.add("kind", kind, sender, t_us, names, other_sender)


def _mode_text(heartbeat: Heartbeat) -> str:
    mode = mode_name(heartbeat.type, heartbeat.autopilot, heartbeat.base_mode, heartbeat.custom_mode)
    return f"{'armed' if heartbeat.armed else 'disarmed'} in {mode}"
