"""Who speaks under one system id: turns what is heard into contradictions, and those into words."""

from __future__ import annotations

import math
from collections.abc import Callable

from infra.reporting import Throttle
from mavlink.duplicate_id.autopilot_id import Hardware, hardware_of
from mavlink.duplicate_id.claimed_places import LATE_MOST_US, Places, same_way
from mavlink.duplicate_id.id_conflict import Claim, Conflict, Contest, Turns
from mavlink.duplicate_id.sender_consistency import AttitudeTracks, turned
from mavlink.estimation.attitudes import Pose
from mavlink.estimation.position_validation import GateParams
from mavlink.protocol.messages import Attitude, GlobalPosition, Heartbeat
from mavlink.protocol.modes import kind_name, mode_name
from mavlink.protocol.packet import Packet
from mavlink.reception.reception import Speaker
from mavlink.reception.rejections import REPORT_AGAIN_US
from mavlink.state import Level

__all__ = ["Senders"]

_SEVERAL_US = 3_000_000
_LEADS_US = 2_000_000  # places come once a second, and then tell whether a link is quicker or a clock another
_BOOT_US = 500_000  # an autopilot's Unix time and boot time keep step to a millisecond, once it has GPS time
_ADDRESS_TURNS = 4
_ADDRESSES_US = 600_000_000  # two radios into one port last a whole flight
_KINDS = 8
_USUAL, _OTHER = "usual", "other"


class Senders:
    """The senders of one system id.

    Args:
        params: what the vehicle can do.
        drives: a ground vehicle.
        links: names of the links by index, for what is told.
        address: of a link's index and a peer's number, in words; empty where it is not known.
    """

    def __init__(
        self,
        params: GateParams,
        *,
        drives: bool,
        links: tuple[str, ...] = (),
        address: Callable[[int, int], str] = lambda link, peer: "",
    ) -> None:
        self.reports = Throttle(REPORT_AGAIN_US)
        self._rare_reports = Throttle(_ADDRESSES_US)
        self.hardware_text = ""
        """Hardware id in hexadecimal, empty until told."""
        self._links, self._address = links, address
        self._contest = Contest()
        self._contested = False
        self._places = Places(params, drives=drives)
        self._attitudes = AttitudeTracks()
        self._kinds: dict[tuple[int, int], tuple[int, Speaker]] = {}
        self._kind: tuple[int, int] | None = None
        self._beat: tuple[Heartbeat, Speaker] | None = None
        self._boot: tuple[int, int, Speaker] | None = None
        self._board: tuple[Hardware, int, Speaker] | None = None
        self._speaker = Speaker(-1, 0, 0)
        self._changed_us = 0
        self._addresses = Turns()
        self._clock_speaker = self._clock_other = self._speaker
        self._leading = (self._speaker, 0)
        self._autopilot: Speaker | None = None

    def speaks(self, speaker: Speaker, t_us: int) -> None:
        """Somebody said something."""
        before = self._speaker
        if speaker == before:
            return
        self._speaker = speaker
        if before.link < 0:
            return
        self._changed_us = t_us
        if before.link == speaker.link and before.peer != speaker.peer:
            self._addresses.take(speaker.peer, speaker, before, t_us)

    def several(self, t_us: int) -> bool:
        """Whether more than one speaker was heard in the last seconds: two radios, or two vehicles."""
        return abs(t_us - self._changed_us) < _SEVERAL_US

    def contested(self, t_us: int) -> bool:
        """Whether two senders contradict each other."""
        return self._contest.contested(t_us)

    def heartbeat(self, sample: Heartbeat, speaker: Speaker) -> tuple[str, str] | None:
        """Compares the kind of vehicle with what was said before; both in words when it is a new one."""
        kind, before = (sample.type, sample.autopilot), self._kind
        self._kind = kind
        self._kinds.pop(kind, None)
        self._kinds[kind] = (sample.t_us, speaker)
        if len(self._kinds) > _KINDS:
            del self._kinds[next(iter(self._kinds))]
        if len(self._kinds) > 1:
            self._compare_kinds(kind, speaker, sample.t_us)
        if before is None or kind_name(before[0]) == kind_name(kind[0]):
            return None
        return kind_name(before[0]), kind_name(kind[0])

    def mode(self, sample: Heartbeat, speaker: Speaker) -> None:
        """Compares armed and mode with what another said: whoever changes them changes them on all its radios."""
        before, self._beat = self._beat, (sample, speaker)
        if before is None or before[1] == speaker or not abs(sample.t_us - before[0].t_us) < _SEVERAL_US:
            return
        one, other = _mode(before[0]), _mode(sample)
        if one != other:
            self._contest.take("mode", speaker, speaker, sample.t_us, f"{one} and {other}", before[1])

    def booted(self, t_us: int, speaker: Speaker, moment_us: int) -> None:
        """When the vehicle was switched on, by its own Unix time: no delay of a link changes that."""
        before, self._boot = self._boot, (moment_us, t_us, speaker)
        if before is None or not abs(t_us - before[1]) < _SEVERAL_US or abs(moment_us - before[0]) < _BOOT_US:
            return
        detail = f"two vehicles, switched on {abs(moment_us - before[0]) * 1e-6:.1f} s apart"
        self._contest.take("boot", moment_us > before[0], speaker, t_us, detail, before[2])

    def other_clock(self, t_us: int, speaker: Speaker, gap_s: float) -> None:
        """A boot time that is not of this vehicle's count, nor of the one before its reboot.

        Args:
            gap_s: how much later the message came than its boot time allows; negative when it came earlier.
        """
        if -LATE_MOST_US <= gap_s * 1e6 < 0 and not self._is_other(speaker, t_us):
            return
        self._clock_other = speaker
        detail = f"two clocks, {abs(gap_s):.0f} s apart"
        self._contest.take("clock", _OTHER, speaker, t_us, detail, self._clock_speaker)

    def _is_other(self, speaker: Speaker, t_us: int) -> bool:
        """Whether one who is some seconds ahead is another's clock, not this vehicle's over a quicker link."""
        if self._places.tells(speaker, t_us):
            return False  # its places decide
        if self._leading[0] != speaker:
            self._leading = (speaker, t_us)
        return t_us - self._leading[1] >= _LEADS_US

    def usual_clock(self, t_us: int, speaker: Speaker) -> None:
        """A boot time that fits."""
        self._clock_speaker = speaker
        if self._contest.disputed("clock", t_us):
            self._contest.take("clock", _USUAL, speaker, t_us, "two clocks", self._clock_other)

    def place(self, sample: GlobalPosition, speaker: Speaker, std_m: float) -> None:
        """A place of any component: compared with what others said."""
        dissent = self._places.take(speaker, sample, std_m)
        if dissent:
            detail = f"two places, {dissent.gap_m:.0f} m apart"
            self._contest.declare("place", detail, speaker, dissent.other, sample.t_us)

    def quicker(self, speaker: Speaker, t_us: int) -> bool:
        """Whether a sender turned out to be the same vehicle over a quicker link, or nobody else tells a place."""
        if self._places.quicker(speaker):
            return True
        return not same_way(speaker, self._clock_speaker) and self._places.alone(speaker, t_us)

    def trails(self, speaker: Speaker) -> bool:
        """Whether it turned out to be the same vehicle over a later one."""
        return self._places.trails(speaker)

    def autopilots(self, t_us: int, speaker: Speaker, rival: int) -> None:
        """Two components beat as the autopilot, and only the one that is not taken for it reports.

        Args:
            speaker: whose heartbeat came.
            rival: id of the one that reports, negative for none.
        """
        before, self._autopilot = self._autopilot, speaker
        sides = (before.component, speaker.component) if before is not None else ()
        if before is not None and rival in sides and speaker.component != before.component:
            detail = "two autopilots, and the other than before tells a place"
            self._contest.take("autopilot", speaker.component, speaker, t_us, detail, before)

    def attitude(self, boot_us: int, sample: Attitude, speaker: Speaker) -> None:
        """An attitude, while several speak."""
        dissent = self._attitudes.take(speaker, boot_us, sample)
        if dissent:
            detail = f"two attitudes, {math.degrees(dissent.gap):.0f}° apart"
            self._contest.take("attitude", speaker, speaker, sample.t_us, detail, dissent.other)

    def late_attitude(self, sample: Attitude, speaker: Speaker, then: Pose | None) -> None:
        """An attitude that came late: the vehicle's own word is known to the one that it gave then."""
        if then is not None and then.bracketed and turned(sample, then, then.age_s):
            self._clock_other = speaker
            self._contest.take(
                "clock", _OTHER, speaker, sample.t_us, "two clocks and two attitudes", self._clock_speaker
            )

    def hardware(self, packet: Packet, speaker: Speaker, epoch: int) -> str:
        """Hardware id, compared with the one before; says so when the board was changed."""
        board, known = hardware_of(packet), self._board
        if not board.text:
            return ""
        if known is None or not known[0].differs(board):
            self._board = (board, epoch, speaker)
            self.hardware_text = board.text
            return ""
        if known[1] != epoch:
            self._board, self.hardware_text = (board, epoch, speaker), board.text
            return f"is another autopilot since it has rebooted (hardware id {board.text})"
        detail = f"two autopilots, hardware id {known[0].text} and {board.text}"
        self._contest.declare("uid", detail, speaker, known[2], packet.t_us)
        return ""

    def news(self, t_us: int, system_id: int) -> tuple[Level, str]:
        """What to tell since the last call; an empty text for nothing."""
        contested = self._contest.contested(t_us)
        if contested == self._contested:
            return ("info", "") if contested else ("warning", self._two_addresses(t_us, system_id))
        self._contested = contested
        if not contested:
            return "info", f"system id {system_id} has one sender again: {self.where(self._speaker)}"
        conflict = self._contest.conflict
        assert conflict is not None
        text = f"two senders use system id {system_id}: its positions are not used; {self._words(conflict)}"
        return "alarm", text

    def _two_addresses(self, t_us: int, system_id: int) -> str:
        """A second radio into one port looks like this, and so does somebody who says the same: told, not refused."""
        turns = self._addresses
        if not turns.established(_ADDRESS_TURNS, t_us) or not self._rare_reports.due("addresses", t_us):
            return ""
        return f"system {system_id} speaks from two addresses ({self.where(turns.other)} and {self.where(turns.where)})"

    def where(self, speaker: Speaker) -> str:
        """A channel in words, without the component."""
        name = self._links[speaker.link] if 0 <= speaker.link < len(self._links) else f"link {speaker.link}"
        address = self._address(speaker.link, speaker.peer) if speaker.peer else ""
        if address:
            return f"{address} on {name}"
        return f"{name} address {speaker.peer}" if speaker.peer else name

    def _words(self, conflict: Conflict) -> str:
        one, other = self.where(conflict.other), self.where(conflict.one)
        components = conflict.other.component, conflict.one.component
        if components[0] != components[1]:
            return f"{conflict.detail}: component {components[0]} at {one} and component {components[1]} at {other}"
        return f"{conflict.detail}: {one} and {other}" if one != other else f"{conflict.detail}: both on {one}"

    def _compare_kinds(self, kind: tuple[int, int], speaker: Speaker, t_us: int) -> None:
        claim: Claim = "kind"
        for other in list(self._kinds):
            seen_us, other_speaker = self._kinds[other]
            if not abs(t_us - seen_us) < _SEVERAL_US:
                del self._kinds[other]
            elif other != kind:
                names = f"a {kind_name(other[0])} and a {kind_name(kind[0])}"
                if kind_name(other[0]) == kind_name(kind[0]):
                    names = f"type {other[0]} autopilot {other[1]} and type {kind[0]} autopilot {kind[1]}"
                self._contest.take(claim, kind, speaker, t_us, names, other_speaker)


def _mode(beat: Heartbeat) -> str:
    mode = mode_name(beat.type, beat.autopilot, beat.base_mode, beat.custom_mode)
    return f"{'armed' if beat.armed else 'disarmed'} in {mode}"
