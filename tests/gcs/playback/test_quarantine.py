"""A real recording in which, for a while, somebody else speaks under the id of one of the vehicles."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from gcs.playback.analysis import Analysis
from gcs.playback.hindsight import by_hindsight
from gcs.session.identity_log import IdentityLog
from gcs.session.session import open_session
from mavlink.protocol.dialect import DEFINITIONS
from mavlink.tlog.log import Tlog
from tests.support.bundled import SWARM, shortened, with_packets, with_sender

S = 1_000_000
BEGIN_S, END_S, FRAMES = 25, 33, 250
"""Seconds of the log; its frames begin at 15 s, ten a second."""
VICTIM, OTHER = 4, 6


@pytest.mark.slow
def test_no_name_comes_out_of_quarantine(tmp_path):
    """For a while another rover also speaks as the victim."""
    start_us = int(Tlog.open(SWARM / "telemetry.tlog").index.t_us[0])
    begin_us, end_us = start_us + BEGIN_S * S, start_us + END_S * S

    def invade(packet):
        yield packet
        speaks = packet.system_id == OTHER and packet.message_id in (0, 33) and packet.message_id in DEFINITIONS
        if speaks and begin_us <= packet.t_us < end_us:
            yield replace(packet, t_us=packet.t_us + 37_000, raw=with_sender(packet.raw, VICTIM))

    with_packets(shortened(SWARM, tmp_path / "short", FRAMES), tmp_path / "session", invade)
    events = []
    analysis = Analysis(open_session(tmp_path / "session"))
    snapshots = list(analysis.snapshots(images=False))
    with IdentityLog(tmp_path / "out") as log:
        for snapshot in snapshots:
            log.write(snapshot)
            events += snapshot.events
    with (tmp_path / "out" / "identity.csv").open() as file:
        names = np.array([(int(row["time_us"]), int(row["system_id"] or 0)) for row in csv.DictReader(file)])
    alarms = [event for event in events if event.text.startswith(f"two senders use system id {VICTIM}")]
    assert len(alarms) == 1 and alarms[0].level == "alarm"
    found_us = alarms[0].t_us
    assert found_us - begin_us <= 2 * S
    named = names[names[:, 1] == VICTIM, 0]
    assert (named < begin_us).any()
    assert not ((named > found_us) & (named < end_us + 4 * S)).any()
    later = list(by_hindsight(snapshots, analysis.mission))
    told_us = [each.t_us for each in later for box in each.boxes if box.system_id == VICTIM]
    assert min(told_us) < begin_us and not any(found_us < t_us < end_us + 4 * S for t_us in told_us)
    others = names[(names[:, 0] > found_us) & (names[:, 0] < end_us), 1]
    assert {2, 3, 5, 6, 7} <= set(others.tolist())
    released = [event.t_us for event in events if "one sender again" in event.text]
    assert len(released) == 1 and end_us + 4 * S < released[0] < end_us + 5 * S
