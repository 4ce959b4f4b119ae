"""What became of a vehicle's packets: one account, of rows and in what speaks against a candidate."""

import math

import pytest

from gcs.fold.candidates import missing_because
from gcs.health.heard import refused_because
from gcs.snapshot import VehicleRow

SEVERAL, JAMMED = "several senders use its system id", "receiver jammed or failing"


REFUSED, PLAYED = "all its packets are refused", "a recording of its signed packets is replayed"
HELD = "nothing proves that its packets are new"
HEARD = {"heartbeat_age_s": 1.0}
WRONG = {"position_state": "refused"}
CANNOT = "its positions cannot be right"


@pytest.mark.parametrize(
    ("known", "refused", "missing"),
    [
        ({}, "", "never heard"),
        ({"contested": True}, SEVERAL, SEVERAL),
        ({"bad_signature": 3}, "packets with a wrong signature", REFUSED),
        ({"replayed": 3, "bad_signature": 3}, PLAYED, REFUSED),
        ({"held": 2}, HELD, REFUSED),
        ({"unsigned": 1}, "unsigned packets", REFUSED),
        (HEARD | {"held": 2, "held_s": 90.0}, HELD, HELD),
        (HEARD | {"unsigned": 1}, "", "no position yet"),
        (HEARD | WRONG | {"refused_for": JAMMED}, JAMMED, f"its positions are refused: {JAMMED}"),
        (HEARD | WRONG, CANNOT, CANNOT),
    ],
)
def test_refusals_are_told_alike(known, refused, missing):
    row = VehicleRow(system_id=11, name="UGV-11", role="ugv", **known)
    assert (refused_because(row), missing_because(row, math.inf, contradicted=False)) == (refused, missing)


@pytest.mark.parametrize(
    ("frozen", "missing"), [(False, "no position for 12 s"), (True, "its position has stood still for 12 s")]
)
def test_a_position_that_stands_still_is_no_missing_one(frozen, missing):
    row = VehicleRow(system_id=11, name="UGV-11", role="ugv", position_state="lost", frozen=frozen, **HEARD)
    assert missing_because(row, 12.0, contradicted=False) == missing
