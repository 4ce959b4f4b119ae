from dataclasses import replace

import pytest

from bench.receiving.flood_claims import CASES, CLAIMED, VEHICLES, ClaimCase, ClaimResult, faults

HELD = ClaimResult(
    sent=[100] * VEHICLES, recorded=[100] * VEHICLES, flooded=9_000, of_it=500, flood_s=14.0, silent=False,
    reported=[(3.0, "9.9.9.9:5 as system 11 floods this port"), (20.0, "9.9.9.9:5 is let in whole again")],
)  # fmt: skip
KEPT = [100 if k != CLAIMED - 1 else 51 for k in range(VEHICLES)]
JUNK = next(case for case in CASES if "junk" in case.kinds)


@pytest.mark.parametrize(
    ("case", "changed", "words"),
    [
        (ClaimCase(name="", kinds=("valid",)), {"recorded": KEPT}, []),
        (ClaimCase(name="", kinds=("valid",), spoofed=True), {"recorded": [0 * n for n in KEPT]}, ["others lost"]),
        (JUNK, {"recorded": KEPT}, ["the imitated one lost"]),
        (JUNK, {"silent": True, "reported": ()}, ["false: no heartbeat", "not reported in time"]),
        (JUNK, {"reported": [(2.0, "a flood"), (9.0, "the flood is over")]}, ["said to be over"]),
    ],
)
def test_what_must_not_be_is_told(case, changed, words):
    assert not faults(case, HELD)
    assert faults(case, replace(HELD, **changed)) == words
