"""What the names rest on: the telemetry and nothing else, also under errors unlike the simulator's own."""

import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.playback.analysis import Analysis
from gcs.report.score import score_files
from gcs.session.identity_log import IdentityLog
from gcs.session.session import open_session
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.protocol.framing import checksum
from mavlink.tlog.log import Tlog
from sim.session import write_session
from sim.world.presets import nominal

SWARM = Path("sitl_logs/ardupilot-swarm")


def identify(session, out):
    """The path of the session's identity log."""
    with IdentityLog(out) as log:
        for snapshot in Analysis(open_session(session)).snapshots(images=False):
            log.write(snapshot)
    return out / "identity.csv"


def with_sender(raw, system_id):
    """A MAVLink 2 frame as if another system had sent it."""
    body = raw[:5] + bytes([system_id]) + raw[6 : 10 + raw[1]]
    extra = DEFINITIONS[int.from_bytes(raw[7:10], "little")][1]
    return body + struct.pack("<H", checksum(body, extra))


def deranged(session, out, ids):
    """A copy of a session in which each of our vehicles speaks under the id of the next."""
    shutil.copytree(session, out)
    other = dict(zip(ids, [*ids[1:], ids[0]], strict=True))
    with (out / "telemetry.tlog").open("wb") as file:
        for packet in Tlog.open(session / "telemetry.tlog").packets():
            known = packet.message_id in DEFINITIONS and packet.system_id in other
            raw = with_sender(packet.raw, other[packet.system_id]) if known else packet.raw
            file.write(struct.pack(">Q", packet.t_us) + raw)
    return other


def test_deranged_ids_take_the_names_with_them(tmp_path):
    ids = sorted(set(np.loadtxt(SWARM / "truth.csv", delimiter=",", skiprows=1, usecols=6, dtype=int).tolist()) - {0})
    other = deranged(SWARM, tmp_path / "session", ids)
    before, after = identify(SWARM, tmp_path / "before"), identify(tmp_path / "session", tmp_path / "after")
    assert score_files(SWARM / "truth.csv", before).right > 0.99
    assert score_files(SWARM / "truth.csv", after).right <= 0.01
    rows = [np.genfromtxt(path, delimiter=",", skip_header=1, usecols=3, filling_values=0) for path in (before, after)]
    moved = np.array([other.get(int(i), 0) for i in rows[0]])
    assert np.mean(rows[1] == moved) > 0.99


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
