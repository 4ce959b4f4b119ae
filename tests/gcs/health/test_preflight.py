"""What a flight needs is gone through: all is well, or it is told what is not and what to do."""

from dataclasses import replace

import pytest

from gcs.health.preflight import preflight
from gcs.snapshot import Alarm, Health
from mavlink.transmit.message_rates import Rate
from tests.support.fake_station import make_snapshot

BASE = make_snapshot(live=True)
UAV, UGV = BASE.vehicles[:2]
HEARD = replace(UGV, name="[b]Alpha", position_state="ok", heartbeat_age_s=0.1, signs=True, fix="RTK")
WELL = replace(
    BASE,
    vehicles=(replace(UAV, position_state="ok"), HEARD),
    alarms=(),
    pose="known",
    health=Health(video="ok", fps=12.0, free_bytes=10**11, time_offset_s=0.36, time_offset_std_s=0.02, keys=2),
)
RATE = Rate(system_id=UGV.system_id, link=0, message="GLOBAL_POSITION_INT", wanted_hz=5.0, measured_hz=5.0, state="ok")
BATTERY = Alarm(
    key=f"battery {UGV.system_id}",
    level="warning",
    kind="vehicle",
    text="[b]Alpha: its battery is low",
    advice="bring it back",
    since_us=1,
    system_id=UGV.system_id,
)


def test_all_that_is_well_is_a_line_each():
    found = preflight(WELL, [RATE])
    assert {check.verdict for check in found} == {"ok"}
    assert [f"{check.name}: {check.found}" for check in found][1:] == [
        "[b]Alpha: position 5.0/s, fix RTK, signed",
        f"video: {BASE.width}×{BASE.height}, 12.0 frames/s looked at, lag 0.0 s",
        "video delay: 0.36 s ± 0.02, taken out",
        "camera: field of view and direction are known",
        "disk: 100.0 GB free",
    ]


NEVER = {"heartbeat_age_s": float("inf"), "position_age_s": float("inf"), "position_state": "never"}
UNHEARD = replace(UGV, **NEVER, loss=float("nan"), signed=0, refusals={}, contested=False)


@pytest.mark.parametrize(
    ("change", "rates", "verdict", "found", "advice"),
    [
        ({"vehicles": (UAV, UNHEARD)}, [], "bad", f"system id {UGV.system_id} is not heard", "PX4 MAV_SYS_ID"),
        ({"vehicles": (UAV, replace(UNHEARD, unsigned=9))}, [], "bad", "refused: unsigned packets", "gcs keys check"),
        (
            {"vehicles": (UAV, replace(HEARD, position_state="never", refused_for="no fix"))},
            [],
            *("bad", "no position yet: no fix", "mavlink stream -s GLOBAL_POSITION_INT"),
        ),
        ({}, [replace(RATE, measured_hz=1.0, hint="set it")], "short", "comes at 1.0 of 5 Hz", "set it"),
        ({"alarms": (BATTERY,)}, [], "short", "its battery is low", "bring it back"),
        ({"alarms": (replace(BATTERY, key="disk", system_id=0, level="alarm"),)}, [], "bad", "low", "bring it back"),
        ({"health": replace(WELL.health, video="waiting")}, [], "bad", "no picture comes", "H.264"),
        ({"health": replace(WELL.health, video="none")}, [], "short", "nobody is named", "-v"),
        ({"pose": "unknown"}, [], "short", "its field of view is not known", "CAMERA_FOV_STATUS"),
        ({"pose": "no attitude"}, [], "short", "attitude does not come", "SRx_EXTRA1"),
    ],
)
def test_what_is_not_well_is_told_with_what_to_do(change, rates, verdict, found, advice):
    wrong = [check for check in preflight(replace(WELL, **change), rates) if check.verdict != "ok"]
    mine = [check for check in wrong if found in check.found]
    assert [check.verdict for check in mine] == [verdict] and advice in mine[0].advice, wrong
