"""What is wrong in one snapshot, and what an operator does about it. Pure.

The table of ``docs/operations.md`` has a line for every kind of finding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gcs.snapshot import Health, Level, LinkHealth, Snapshot, VehicleRow
from mavlink.state import SILENT_S

__all__ = ["LOW_BYTES", "LOW_S", "STALLED_S", "Finding", "counted", "findings", "first_of"]

BEATLESS_S = 10.0
BEATS_S = 1.5
"""One that was heard so lately speaks: what it does not say is missing."""
"""One whose positions come is not lost for a few heartbeats that a bad link has swallowed; after this long it is."""
BACK_S = 3.0
"""One that is back beats before it tells its place, which may take so long; of others the place grew stale first."""
NO_ATTITUDE_S = 3.0
HELD_S = 3.0
"""Until then a vehicle that tells its time once a second has proved itself."""
LATE_S = 1.0
BEHIND_S = 2.0
"""Telemetry is taken in five times a second and more; a moment's hold-up changes nothing that is shown."""
CLOCK_S, CLOCK_SURE_S = 0.1, 0.1
"""A vehicle at 5 m/s is half a metre elsewhere after a tenth of a second."""
STEP_S = 0.5
MOST_NAMES = 4
LOW_BYTES, ALMOST_FULL_BYTES = 2_000_000_000, 200_000_000
LOW_S, ALMOST_FULL_S = 600.0, 120.0
STALLED_S = 1.0
"""A disk that has not answered for so long hangs: a busy one answers within some tenths."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is wrong at one moment."""

    key: str
    level: Level
    kind: str
    text: str
    advice: str
    system_id: int = 0
    wait_s: float = 0.0
    """How long it must last before it is an alarm."""
    told: bool = False
    """Somebody else makes the events of it."""
    settled: bool = False
    """Whoever finds it holds it for some seconds after its last sign already: once it is gone it is over."""
    raises: bool = True
    """False: keeps an alarm that was raised before, and raises none: another finding says it better now."""


def findings(snapshot: Snapshot) -> Iterator[Finding]:
    """All that is wrong now."""
    looked = snapshot.pose != "no attitude"  # else a place in the picture is a guess
    for row in snapshot.vehicles:
        yield from _vehicle(row, looked and row.system_id in snapshot.conflicts)
    yield from _unheard(snapshot)
    yield from _attitude(snapshot)
    for link in snapshot.health.links:
        yield from _link(link)
    yield from _program(snapshot.health)
    yield from _video(snapshot.health)
    yield from _clock(snapshot.health)
    yield from _recording(snapshot.health)
    if snapshot.health.keys == 0:
        yield Finding(
            key="no keys", level="warning", kind="link", text="nothing is authenticated: anybody can pose as a vehicle",
            advice="make keys with gcs keys and give them to the autopilots, or fly where nobody else transmits",
        )  # fmt: skip


def counted(snapshot: Snapshot) -> Iterator[tuple[int, Finding]]:
    """Counters that should stand still, those of vehicles once they count: while one grows, its finding is true."""
    keyed = bool(snapshot.health.keys)
    for row in snapshot.vehicles:
        whose, i = row.name, row.system_id
        if wrong := row.bad_signature - row.replayed:
            yield wrong, Finding(
                key=f"signature {i}", level="alarm", kind="link", system_id=i, told=True,
                text=f"{whose}: packets with a wrong signature are refused",
                advice="somebody poses as it, its key is another, or its clock is minutes ahead: gcs keys list",
            )  # fmt: skip
        if row.replayed:
            yield row.replayed, Finding(
                key=f"replay {i}", level="alarm", kind="link", system_id=i, told=True,
                text=f"{whose}: a recording of its signed packets is played",
                advice="none of it is believed: look for the sender, whose address is in the event log",
            )  # fmt: skip
        if keyed and row.unsigned:
            yield row.unsigned, Finding(
                key=f"unsigned {i}", level="warning", kind="link", system_id=i, told=True,
                text=f"{whose}: unsigned packets are refused",
                advice="turn signing on in its autopilot; if it is on, somebody else sends in its name",
            )  # fmt: skip
    for link in snapshot.health.links:
        yield link.dropped, Finding(
            key=f"dropped {link.name}", level="alarm", kind="link",
            text=f"{link.name}: the system drops packets before they can be read",
            advice="free the processor; allow larger receive buffers (net.core.rmem_max)",
        )  # fmt: skip
    health = snapshot.health
    yield health.ingest_restarts, Finding(
        key="ingest", level="alarm", kind="link", text="the receiving process had to be started again",
        advice="packets of that moment may be missing; note the time and keep the session for a report",
    )  # fmt: skip
    yield health.ring_dropped, Finding(
        key="ring", level="warning", kind="link", text="packets are recorded but not shown: the program is too slow",
        advice="free the processor: close other programs, or take a smaller detector",
    )  # fmt: skip
    yield health.faults, Finding(
        key="fault", level="warning", kind="program", text=f"a fault of this program was passed over: {health.fault}",
        advice="names may be missing for that moment; the recording is whole; send in faults.txt of the session",
    )  # fmt: skip
    yield health.undecoded, Finding(
        key="undecoded", level="warning", kind="video", text="pictures cannot be decoded",
        advice="the video link loses data: lower its bit rate or come closer", wait_s=2.0,
    )  # fmt: skip
    yield health.write_lost, Finding(
        key="lost", level="alarm", kind="recording", told=True, text="telemetry could not be recorded and is lost",
        advice="land; what was flown since is in no file",
    )  # fmt: skip


def _vehicle(row: VehicleRow, conflict: bool) -> Iterator[Finding]:
    whose, i = row.name, row.system_id
    if row.contested:
        yield Finding(
            key=f"contested {i}", level="alarm", kind="vehicle", system_id=i, told=True, settled=True,
            text=f"{whose}: several senders use system id {i}; none is believed",
            advice="find the second one by the address in the event log; switch it off or give it another id",
        )  # fmt: skip
    if conflict:
        yield Finding(
            key=f"conflict {i}", level="alarm", kind="identity", system_id=i,
            text=f"{whose}: the place it reports contradicts the picture",
            advice="do not act on its name; compare its position with what you see",
        )  # fmt: skip
    if not math.isnan(row.held_s):
        yield Finding(
            key=f"held {i}", level="alarm", kind="link", system_id=i, wait_s=HELD_S, told=True,
            text=f"{whose}: held, since nothing proves that its signed packets are made now",
            advice="b believes it, if you know that it drives; it should send SYSTEM_TIME; all held: set this clock",
        )  # fmt: skip
    if math.isinf(row.heartbeat_age_s):
        return
    speaks = row.position_state == "ok" and row.heartbeat_age_s < BEATLESS_S
    silent = row.heartbeat_age_s > SILENT_S and not speaks
    if silent:
        yield Finding(
            key=f"silent {i}", level="alarm", kind="vehicle", system_id=i, text=f"{whose}: no heartbeat",
            advice="its radio or power is gone, or it is out of range; its last place stays on the map",
        )  # fmt: skip
    # that a silent vehicle sends no positions goes without saying; what was wrong before is not over by that
    yield from (replace(finding, raises=not silent) for finding in _position(row, silent))
    if row.doubted_for:
        yield Finding(
            key=f"doubted {i}", level="alarm", kind="vehicle", system_id=i,
            text=f"{whose}: its own autopilot doubts its position: {row.doubted_for}",
            advice="its receiver is jammed, spoofed or failing: do not act on its name; it may stop or land by itself",
        )  # fmt: skip
    if row.compass_doubted:
        yield Finding(
            key=f"compass {i}", level="alarm", kind="vehicle", system_id=i,
            text=f"{whose}: its compass contradicts its motion",
            advice="its heading is not used; a magnet, a current or a wrong calibration: do not let it steer by it",
        )  # fmt: skip
    if row.clock_fault:
        yield Finding(
            key=f"clock {i}", level="warning", kind="vehicle", system_id=i, wait_s=10.0,
            text=f"{whose}: its clock is wrong: {row.clock_fault}",
            advice="its positions are dated by this computer's clock; check its GPS time, and restart it later",
        )  # fmt: skip


def _position(row: VehicleRow, silent: bool) -> Iterator[Finding]:
    whose, i, state = row.name, row.system_id, row.position_state
    if state == "refused" or (silent and row.refused_for):
        yield Finding(
            key=f"refused {i} {row.refused_for}".rstrip(), level="alarm", kind="vehicle", system_id=i, wait_s=1.0,
            text=f"{whose}: its positions cannot be right" + (f": {row.refused_for}" if row.refused_for else ""),
            advice="its receiver fails, is jammed or is spoofed; do not act on its name",
        )  # fmt: skip
    elif state in ("lost", "stale") and (silent or row.heartbeat_age_s < BEATS_S):
        lost = state == "lost"
        yield Finding(
            key=f"position {i}", level="alarm" if lost else "warning", kind="vehicle", system_id=i,
            wait_s=BACK_S if lost else 1.0,
            text=f"{whose}: position {state}",
            advice="heartbeats come, positions do not: check its stream rates and its receiver",
        )  # fmt: skip
    elif state == "never":
        yield Finding(
            key=f"no position {i}", level="warning", kind="vehicle", system_id=i, wait_s=10.0,
            text=f"{whose}: no position yet", advice="wait for its GPS fix; ask for its position stream",
        )  # fmt: skip


def _unheard(snapshot: Snapshot) -> Iterator[Finding]:
    """One finding for all: at the start of a flight it is everybody."""
    silent = [row.name for row in snapshot.vehicles if math.isinf(row.heartbeat_age_s) and not _refused(row)]
    if silent and len(silent) < len(snapshot.vehicles):
        yield Finding(
            key="unheard", level="warning", kind="vehicle", wait_s=15.0, text=f"never heard: {first_of(silent)}",
            advice="switch them on, check their system ids against the mission, or take them out of it",
        )  # fmt: skip


def _attitude(snapshot: Snapshot) -> Iterator[Finding]:
    if snapshot.pose != "no attitude":
        return
    for row in snapshot.vehicles:
        if row.role == "uav" and row.heartbeat_age_s < BEATS_S:
            yield Finding(
                key="attitude", level="alarm", kind="vehicle", system_id=row.system_id, wait_s=NO_ATTITUDE_S,
                text=f"{row.name}: no attitude", advice="nothing can be named without it: check its stream rates",
            )  # fmt: skip


def first_of(names: Sequence[str]) -> str:
    """``a, b, c, d and 16 more``."""
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _refused(row: VehicleRow) -> bool:
    """Whether it is heard and not believed, of which there is a finding already."""
    return bool(row.bad_signature or row.unsigned or row.held)


def _link(link: LinkHealth) -> Iterator[Finding]:
    advice = "check radio, cable and port; vehicles send nothing until asked"
    if link.name.startswith("udpout:"):
        advice = "only with --command does this station speak first: else have the other end send here, and use udpin"
    key, what = "link", "nothing comes"
    if link.junk_bytes and not link.packets:
        key, what, advice = "junk", "what comes is no MAVLink", "check the baud rate, and what sends there"
    if not link.silent_s <= SILENT_S:
        yield Finding(
            key=f"{key} {link.name}", level="alarm", kind="link", wait_s=10.0 if math.isinf(link.silent_s) else 0.0,
            text=f"{link.name}: {what}", advice=advice,
        )  # fmt: skip
    if link.flooded:
        yield Finding(
            key=f"flood {link.name}", level="alarm", kind="link", told=True,
            text=f"{link.name}: it is flooded, and not all is let in",
            advice="find the sender: the event log has its address, which may be forged; vehicles keep their place",
        )  # fmt: skip


def _program(health: Health) -> Iterator[Finding]:
    if health.behind_s > BEHIND_S:
        yield Finding(
            key="overload", level="alarm", kind="program", text="this computer cannot keep up: telemetry comes in late",
            advice="what is shown is as old; free the processor: close other programs, or take a smaller detector",
        )  # fmt: skip


def _video(health: Health) -> Iterator[Finding]:
    if health.video == "stalled":
        yield Finding(
            key="video", level="alarm", kind="video", told=True, text="the video stands still",
            advice="names are not renewed; it is opened again by itself: check the camera and its link",
        )  # fmt: skip
    elif health.video == "ok" and health.lag_s > LATE_S:
        yield Finding(
            key="lag", level="warning", kind="video", wait_s=3.0, text="the picture is more than a second late",
            advice="free the processor, or take a smaller detector or a smaller stream",
        )  # fmt: skip


def _clock(health: Health) -> Iterator[Finding]:
    std_s = health.time_offset_std_s
    if std_s < CLOCK_SURE_S and abs(health.time_offset_s) > CLOCK_S + std_s:
        yield Finding(
            key="video clock", level="warning", kind="video", wait_s=5.0,
            text=f"the video's clock is {health.time_offset_s:+.1f} s from the telemetry's",
            advice='it is corrected while flying; put video_offset_s or "auto" into the mission',
        )  # fmt: skip
    if abs(health.clock_step_s) > STEP_S:
        yield Finding(
            key="clock step", level="warning", kind="recording", text="this computer's clock was set during the flight",
            advice="times in the session are told by its own record of the clock; leave the clock alone in flight",
        )  # fmt: skip


def _recording(health: Health) -> Iterator[Finding]:
    if health.keys is None and not health.links:
        return  # a replay records nothing
    if not health.recording:
        yield Finding(
            key="recording", level="alarm", kind="recording", wait_s=1.0, text="nothing is recorded",
            advice="land or fly without a record; look at the event log for the reason",
        )  # fmt: skip
    if health.write_failing_s > 0:
        reason = f": {health.write_reason}" if health.write_reason else ""
        yield Finding(
            key="disk", level="alarm", kind="recording", told=True,
            text="the recording cannot be written" + reason,
            advice="packets wait in memory for a minute at least: free space or bring the disk back",
        )  # fmt: skip
    if health.write_stalled_s > STALLED_S:
        yield Finding(
            key="disk hangs", level="alarm", kind="recording", told=True,
            text="the disk does not answer: what comes is kept in memory",
            advice="packets wait in memory for a minute at least, video is not recorded: bring the disk back",
        )  # fmt: skip
    full = health.free_bytes < ALMOST_FULL_BYTES or health.full_in_s < ALMOST_FULL_S
    if full or health.free_bytes < LOW_BYTES or health.full_in_s < LOW_S:
        left = f", {health.full_in_s / 60:.1f} min at this rate" if math.isfinite(health.full_in_s) else ""
        yield Finding(
            key="disk space", level="alarm" if full else "warning", kind="recording",
            text=("the disk is almost full" if full else "the disk will be full soon")
            + f": {health.free_bytes / 1e6:,.0f} MB free{left}",
            advice="free space; nothing that was recorded is ever deleted by this program",
        )  # fmt: skip
