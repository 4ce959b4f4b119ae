"""Alarms of one vehicle, from its row of the fleet table."""

from __future__ import annotations

import math

from gcs.health.alarm_rule import AlarmRule
from gcs.snapshot import Snapshot, VehicleRow
from mavlink.estimation.clock_health import CLOCK_ERROR_S, DRIFT_PPM
from mavlink.estimation.interpolation import LOST_S
from mavlink.estimation.origin import FLEET_SPAN_M
from mavlink.state import SILENT_S

GARBLED_PER_S = 20.0
"""Stray bytes a second from which on a link brings garbled bytes: as many as a heartbeat a second has."""
NO_HEARTBEAT_S = 10.0
"""A vehicle whose positions come is not silent for a few heartbeats that a bad link has swallowed, but after this."""
SPEAKS_S = 1.5
"""A vehicle whose heartbeat is no older sends: what does not come is missing."""
UNSTEADY_S = 1.0
"""Time for which positions may be stale, or be rejected, without an alarm: radios hold them up."""
STILL_S = 2.0
"""Time for which nothing but a stale position may come over and over, without an alarm."""
BACK_S = 3.0
"""Time from the first heartbeats of a vehicle that is back to its positions."""
NO_POSITION_S = 10.0
"""A receiver that knows the satellites finds its position in this time."""
NO_ATTITUDE_S = 3.0
"""Seconds without attitude: as long as a position takes to be lost."""
HELD_S = 3.0
"""Time within which a vehicle that sends its time once a second has proved that its packets are new."""
CLOCK_FAULT_S = 5.0
"""A clock that was set a moment ago is still in messages that were made before."""
LOSS_S = 5.0
"""A loss that is over by then needs no action."""
BAD_LOSS = 0.5
"""Share of packets lost from which on it is an alarm whatever the mission's limit: a position a second becomes one in
two, and is stale between them."""
STANDS_STILL = "its position stands still"
CONTRADICTED, DOUBTED = "its position contradicts the video", "it doubts its own position"
"""The sentences of screens, events, candidates and exports alike."""
APART_M, APART_STDS, APART_S = 8.0, 3.0, 1.0
"""Distance of a vehicle's box from its position, metres, and in its receiver's 1σ, that may last no longer than this:
biases wander by some metres, and boxes are next to each other."""
LEFT_S, FITS_S = 2.0, 2.0
"""Time for which a vehicle without a name must report to be far from the box that it was, and time for which one that
was contradicted must be at its box again: a tracker may exchange two boxes, and a wrong position passes others."""
FOLLOWED_S = 1.5
"""Frames that are farther apart follow nobody: what was which box before the gap proves nothing behind it."""


def _ever_received(row: VehicleRow) -> bool:
    return math.isfinite(row.heartbeat_age_s)


def _silent(row: VehicleRow) -> bool:
    positions_come = row.position_state == "ok" and row.heartbeat_age_s < NO_HEARTBEAT_S
    return row.heartbeat_age_s > SILENT_S and _ever_received(row) and not positions_come


def _garbled(row: VehicleRow, now: Snapshot) -> str:
    """Word on what its link brings in place of its packets; empty where that is nothing, or not known."""
    link = next((link for link in now.health.links if link.index == row.link >= 0), None)
    if link is None or not link.junk_per_s >= GARBLED_PER_S:
        return ""
    # of a link that several share nobody knows whose bytes they were
    return f"its link brings garbled bytes{', perhaps its own' * (link.silent_s < SPEAKS_S)}"


def answers(row: VehicleRow) -> bool:
    """Tell whether it was received before, and is now."""
    return _ever_received(row) and not _silent(row)


def _is_held(row: VehicleRow, now: Snapshot) -> bool:
    return not math.isnan(row.held_s)


def _wrong_signatures(row: VehicleRow, now: Snapshot) -> int:
    return row.bad_signature - row.replayed


def _unsigned(row: VehicleRow, now: Snapshot) -> int:
    return row.unsigned if now.health.keys else 0


def _contradicted(row: VehicleRow, now: Snapshot) -> bool:
    # without an attitude, where the image shows the ground is a guess
    return row.system_id in now.conflicts and now.pose != "no attitude"


def _no_attitude(row: VehicleRow, now: Snapshot) -> bool:
    return row.role == "uav" and now.pose == "no attitude" and row.heartbeat_age_s < SPEAKS_S


def _loses(row: VehicleRow, now: Snapshot) -> bool:
    # two senders of one id count separately, which looks like a loss
    return row.loss > now.limits.loss and answers(row) and not row.contested


VEHICLE_RULES: tuple[AlarmRule[VehicleRow], ...] = (
    AlarmRule(
        key="silent",
        level="alarm",
        kind="vehicle",
        text="no heartbeat",
        on_and_off="it is heard on and off",
        meaning=f"nothing received for {SILENT_S:g} s, or no heartbeat for {NO_HEARTBEAT_S:g} s though positions come; "
        f"where its link brings {GARBLED_PER_S:g} bytes a second and more that are no packets, that is given",
        advice="its radio or power is gone, it is out of range, or all it sends is refused or garbled; its last "
        "position stays on the map",
        # what is held comes, and is an alarm of its own
        condition=lambda row, now: _silent(row) and not _is_held(row, now),
        detail=_garbled,
    ),
    # that a silent vehicle sends no positions goes without saying; what was wrong before is not over by that
    AlarmRule(
        key="position",
        level="warning",
        kind="vehicle",
        text="position stale",
        on_and_off="its positions come and go",
        meaning=f"heartbeats come, and no new position for twice its usual interval and more than {UNSTEADY_S:g} s",
        advice="check its stream rates",
        condition=lambda row, _: row.position_state == "stale" and not row.frozen and row.heartbeat_age_s < SPEAKS_S,
        kept_while=lambda row, _: row.position_state == "stale" and _silent(row),
        lasts_s=UNSTEADY_S,
    ),
    AlarmRule(
        key="position",
        level="alarm",
        kind="vehicle",
        text="position lost",
        on_and_off="its positions come and go",
        meaning=f"heartbeats come, and no new position for more than {LOST_S:g} s, and four times as long as usual",
        advice="check its stream rates",
        condition=lambda row, _: row.position_state == "lost" and not row.frozen and row.heartbeat_age_s < SPEAKS_S,
        kept_while=lambda row, _: row.position_state == "lost" and _silent(row),
        lasts_s=BACK_S,
    ),
    AlarmRule(
        key="frozen",
        level="alarm",
        kind="vehicle",
        text=STANDS_STILL,
        meaning=f"heartbeats and positions come, and for {STILL_S + 1.0:g} s and more all of one place though it "
        "reports to drive, or all of one time",
        advice="its receiver or its autopilot hangs, and it may be elsewhere by now: stop it, and restart what hangs",
        condition=lambda row, _: row.frozen and row.heartbeat_age_s < SPEAKS_S,
        kept_while=lambda row, _: row.position_state == "lost" and _silent(row),
        lasts_s=STILL_S,
    ),
    AlarmRule(
        key="refused",
        level="alarm",
        kind="vehicle",
        text="its positions cannot be right",
        meaning="0/0, a jump, a position that jumps to and fro, an impossible height or speed, a place "
        f"{FLEET_SPAN_M / 1e3:g} km from the others, for {UNSTEADY_S:g} s: the reason is given",
        advice="its receiver fails, is jammed or is spoofed: do not act on its name",
        condition=lambda row, _: row.position_state == "refused" and answers(row),
        detail=lambda row, _: row.refused_for,
        each_detail=True,
        kept_while=lambda row, _: bool(row.refused_for) and _silent(row),
        lasts_s=UNSTEADY_S,
        doubts_name=True,
    ),
    AlarmRule(
        key="no position",
        level="warning",
        kind="vehicle",
        text="no position yet",
        meaning=f"received for {NO_POSITION_S:g} s, and no position",
        advice="wait for its GPS fix; ask for its position stream",
        condition=lambda row, _: row.position_state == "never" and answers(row),
        kept_while=lambda row, _: row.position_state == "never" and _silent(row),
        lasts_s=NO_POSITION_S,
    ),
    AlarmRule(
        key="doubted",
        level="alarm",
        kind="vehicle",
        text="its autopilot doubts its position",
        meaning="its filter rejects its receiver or has nothing that corrects it, GPS glitch, EKF failsafe, a receiver "
        "elsewhere than the estimate, a jump: the reason is given. Its names are of little confidence then, and the "
        "camera is not sent there",
        advice="its receiver is jammed, spoofed or failing: do not act on its name; it may stop or land by itself",
        condition=lambda row, _: bool(row.doubted_for) and _ever_received(row),
        detail=lambda row, _: row.doubted_for,
        doubts_name=True,
    ),
    AlarmRule(
        key="compass",
        level="alarm",
        kind="vehicle",
        text="its compass contradicts its motion",
        meaning="compass innovations are beyond what its filter allows",
        advice="its heading is not used; a magnet, a current or a wrong calibration: do not let it steer by it",
        condition=lambda row, _: row.compass_doubted and _ever_received(row),
    ),
    AlarmRule(
        key="attitude",
        level="alarm",
        kind="vehicle",
        text="no attitude",
        meaning=f"the UAV's position comes, and its attitude has not for {NO_ATTITUDE_S:g} s",
        advice="nothing can be named without it: check its stream rates (ArduPilot: SRn_EXTRA1, from 4.7 on "
        "MAVn_EXTRA1)",
        condition=_no_attitude,
        kept_while=lambda row, now: row.role == "uav" and now.pose != "known" and _silent(row),
        lasts_s=NO_ATTITUDE_S,
    ),
    AlarmRule(
        key="clock",
        level="warning",
        kind="vehicle",
        text="its clock is wrong",
        meaning=f"its date is off by more than {CLOCK_ERROR_S:g} s, or its clock drifts by more than {DRIFT_PPM:g} "
        f"ppm, for {CLOCK_FAULT_S:g} s: how is given",
        advice="its positions are dated by this computer's clock; check its GPS time, and restart it before the next "
        "flight",
        condition=lambda row, _: bool(row.clock_fault) and _ever_received(row),
        detail=lambda row, _: row.clock_fault,
        lasts_s=CLOCK_FAULT_S,
    ),
    AlarmRule(
        key="contested",
        level="alarm",
        kind="vehicle",
        text="several senders use its system id; none is accepted",
        meaning="an impostor, or two vehicles with one id: their positions, clocks, modes or boards cannot be one "
        "vehicle's; with keys only the right one counts",
        advice="find the second one by its address in the event log; switch it off or give it another id",
        condition=lambda row, _: row.contested,
        clears_after_s=0.0,
        logged_by="mavlink.duplicate_id.duplicate_id",
        doubts_name=True,
    ),
    AlarmRule(
        key="conflict",
        level="alarm",
        kind="identity",
        text=CONTRADICTED,
        meaning=f"the position or the name is wrong: for {APART_S:g} s its box, or for {LEFT_S:g} s the one that "
        f"surely was it, is more than {APART_M:g} m and {APART_STDS:g} times its receiver's 1σ away from where it "
        f"reports to be. Over when it has been at its box again for {FITS_S:g} s; a name that it loses before is not "
        f"given again until then. Other names are not touched by it; not told while frames are more than "
        f"{FOLLOWED_S:g} s apart, which follow nobody",
        advice="do not act on its name; compare its position with what you see",
        condition=_contradicted,
        kept_while=lambda row, now: row.system_id in now.conflicts,
        doubts_name=True,
    ),
    AlarmRule(
        key="loss",
        level="warning",
        kind="link",
        text="its packets are lost",
        meaning=f"more than the mission's share `[limits] loss` (0.1) for {LOSS_S:g} s, until it is half of that: by "
        "the sequence numbers where what it sends regularly is missing too, so that a filter on the way is no loss",
        advice="bring it or its radio nearer, turn antennas, or have it send less; its positions come late meanwhile",
        condition=lambda row, now: _loses(row, now) and row.loss <= BAD_LOSS,
        kept_while=lambda row, now: row.loss > 0.5 * now.limits.loss or _silent(row),
        lasts_s=LOSS_S,
    ),
    AlarmRule(
        key="loss",
        level="alarm",
        kind="link",
        text="most of its packets are lost",
        meaning=f"more than {BAD_LOSS:.0%} for {LOSS_S:g} s, where the mission's share is less than 1",
        advice="bring it or its radio nearer, turn antennas, or have it send less; its positions come late meanwhile",
        condition=lambda row, now: _loses(row, now) and row.loss > BAD_LOSS,
        lasts_s=LOSS_S,
    ),
    AlarmRule(
        key="signature",
        level="alarm",
        kind="link",
        text="packets with a wrong signature are rejected",
        meaning="a sender poses as it, its key is another, or its autopilot signs more than ten minutes ahead of time",
        advice="compare its key (gcs keys list), then look for the sender, whose address is in the event log",
        counter=_wrong_signatures,
        logged_by="mavlink.reception.reception",
    ),
    AlarmRule(
        key="replay",
        level="alarm",
        kind="link",
        text="a recording of its signed packets is replayed",
        meaning="packets come again, seconds to days after newer ones: none is accepted",
        advice="look for the sender, whose address is in the event log",
        counter=lambda row, _: row.replayed,
        logged_by="mavlink.reception.reception",
    ),
    AlarmRule(
        key="held",
        level="alarm",
        kind="link",
        text="its packets are held: nothing proves that they are new",
        meaning="its signatures are right, lag by more than a minute (AUTH shows how far), and for "
        f"{HELD_S:g} s no SYSTEM_TIME came: it drove before this station listened, or it is a recording",
        advice="if you know that it drives, b accepts it (docs/signing.md); let it send SYSTEM_TIME; if all are held, "
        "set this computer's clock",
        condition=_is_held,
        lasts_s=HELD_S,
        logged_by="mavlink.reception.reception",
    ),
    AlarmRule(
        key="unsigned",
        level="warning",
        kind="link",
        text="unsigned packets are rejected",
        meaning="signing is off in that vehicle, or another sends in its name: the right vehicle is accepted all the "
        "same",
        advice="turn signing on in its autopilot; gcs keys list shows who has a key, gcs keys remove takes one away; "
        "if it is on, another sends in its name",
        counter=_unsigned,
        logged_by="mavlink.reception.reception",
    ),
)
