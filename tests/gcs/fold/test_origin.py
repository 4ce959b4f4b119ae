"""A UAV whose receiver is wrong for a while costs the names of that while, and none after it."""

import struct
from dataclasses import replace
from itertools import islice

import pytest

from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import SWARM, with_packets, with_payload

FRAMES, SETTLED = 190, 140
"""Nineteen seconds; from frame 140 on names are compared."""


def folded(session):
    """Name of each box by frame, and the texts of all events and alarms."""
    names, texts = [], []
    for snapshot in islice(Analysis(open_session(session)).snapshots(images=False), FRAMES):
        names.append([box.system_id for box in snapshot.boxes])
        texts += [event.text for event in snapshot.events]
    return names, texts


def elsewhere(raw, degrees_e7):
    """The same GLOBAL_POSITION_INT with another latitude and longitude."""

    def move(payload):
        lat, lon = struct.unpack_from("<ii", payload, 4)
        struct.pack_into("<ii", payload, 4, lat + degrees_e7[0], lon + degrees_e7[1])

    return with_payload(raw, move)


@pytest.fixture(scope="module")
def expected():
    return folded(SWARM)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degrees", "start_s", "stop_s", "alarm"),
    [
        ((0, -45), -1.0, 0.05, "the local origin moves by 4,"),
        ((0, -45), -1.0, 6.0, "farther from the others than a radio reaches"),
        ((85, 0), 5.0, 7.5, "farther from the others than a radio reaches"),
        ((0.5, 0), 4.0, 6.0, "the local origin moves by 56 km to the UAV"),
    ],
    ids=["45° at first", "45° for six seconds", "85° in flight", "half a degree in flight"],
)
def test_names_after_a_false_place_of_the_uav_are_those_without_it(tmp_path, expected, degrees, start_s, stop_s, alarm):
    start_us = None

    def misplace(packet):
        nonlocal start_us
        if packet.system_id == 1 and packet.message_id == 33:
            start_us = start_us or packet.t_us
            if start_s <= (packet.t_us - start_us) * 1e-6 < stop_s:
                raw = elsewhere(packet.raw, [round(value * 1e7) for value in degrees])
                packet = replace(packet, raw=raw)
        yield packet

    with_packets(SWARM, tmp_path, misplace)
    names, texts = folded(tmp_path)
    assert names[SETTLED:] == expected[SETTLED:]
    settled = [name for frame in expected[SETTLED:] for name in frame]
    assert sum(map(bool, settled)) > 0.8 * len(settled)
    assert not alarm or any(alarm in text for text in texts)
