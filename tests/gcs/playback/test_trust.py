"""What the names rest on: the telemetry and nothing else, also under errors unlike the simulator's own."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.playback.analysis import Analysis
from gcs.report.score import score_files
from gcs.session.identity_log import IdentityLog
from gcs.session.session import open_session
from mavlink.protocol.dialect import DEFINITIONS
from sim.session import write_session
from sim.world.presets import nominal
from sim.world.scenario import Scenario, ScenarioGround, Targets
from tests.support.bundled import SWARM, shortened, with_packets, with_sender


def identify(session, out):
    """The path of the session's identity log."""
    with IdentityLog(out) as log:
        for snapshot in Analysis(open_session(session)).snapshots(images=False):
            log.write(snapshot)
    return out / "identity.csv"


@pytest.mark.slow
@pytest.mark.parametrize("frames", [80, 300])
def test_deranged_ids_take_the_names_with_them(frames, tmp_path):
    """Each of our vehicles speaks under the id of the next."""
    session = shortened(SWARM, tmp_path / "session", frames)
    truth = session / "truth.csv"
    ids = sorted(set(np.loadtxt(truth, delimiter=",", skiprows=1, usecols=6, dtype=int).tolist()) - {0})
    other = dict(zip(ids, [*ids[1:], ids[0]], strict=True))

    def derange(packet):
        known = packet.message_id in DEFINITIONS and packet.system_id in other
        yield replace(packet, raw=with_sender(packet.raw, other[packet.system_id])) if known else packet

    deranged = with_packets(session, tmp_path / "deranged", derange)
    before, after = identify(session, tmp_path / "before"), identify(deranged, tmp_path / "after")
    assert score_files(truth, before).right > 0.97
    assert score_files(truth, after).right <= 0.01
    rows = [np.genfromtxt(path, delimiter=",", skip_header=1, usecols=3, filling_values=0) for path in (before, after)]
    moved = np.array([other.get(int(i), 0) for i in rows[0]])
    assert np.mean(rows[1] == moved) > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gnss", "ground", "right"),
    [
        ({"tau_s": 10.0, "bias_m": 1.0}, {}, 0.9),
        ({"tau_s": 600.0, "bias_m": 1.5}, {}, 0.97),
        ({"steps_per_min": 3.0, "step_m": 2.0}, {}, 0.97),
        ({}, {"slope_deg": 4.0, "uphill_deg": 60.0}, 0.97),
    ],
    ids=["biases of ten seconds", "biases of ten minutes", "steps as satellites change", "sloping ground"],
)
def test_other_errors_than_the_simulators_own(tmp_path, gnss, ground, right):
    scenario = nominal()
    scenario = replace(
        scenario, duration_s=20.0, gnss=replace(scenario.gnss, **gnss), ground=replace(scenario.ground, **ground)
    )
    write_session(scenario, tmp_path / "session")
    scored = score_files(tmp_path / "session" / "truth.csv", identify(tmp_path / "session", tmp_path / "out"))
    assert scored.precision >= 0.97 and scored.right >= right


@pytest.mark.slow
def test_strangers_in_our_formation_do_not_turn_the_camera(tmp_path):
    """Two that report nothing drive in the formation: a camera 15° off would explain them, too, by the next places."""
    ground, targets = ScenarioGround(kind="formation"), Targets(lookalikes=2, moving=2)
    write_session(Scenario(name="joined", seed=4032, duration_s=20.0, ground=ground, targets=targets), tmp_path / "s")
    scored = score_files(tmp_path / "s" / "truth.csv", identify(tmp_path / "s", tmp_path / "out"))
    assert (scored.precision, scored.wrong_sure_s) == (1.0, 0.0)
    assert scored.right > 0.9
