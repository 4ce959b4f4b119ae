"""A frame waits for the attitude of its own time, in flight not for long, and never where none will come."""

from dataclasses import replace

import pytest

from gcs.fold.pipeline import MAX_WAIT_US, WAIT_US, Pipeline
from gcs.mission.mission import Clock
from gcs.playback.recorded_order import PacketsInOrder
from mavlink.protocol.packet import Packet
from tests.support.flights import FIELD, T0, S
from tests.support.frames import MessageEncoder
from tests.support.snapshots import ONE_UGV

DELAY_US = 20_000


def heard(seconds, *, attitude_hz=10, position_hz=10):
    """The UAV's packets in order of arrival, each some time after it was made."""
    speaker, made = MessageEncoder(1), []
    lat, lon, alt = (float(a) for a in FIELD.to_geodetic([0.0, 0.0, 40.0]))
    for hz, message in (
        (position_hz, lambda ms: speaker.global_position_int(ms, lat, lon, alt, 40.0, (0, 0, 0), 0.0)),
        (attitude_hz, lambda ms: speaker.attitude(ms, 0.0, 0.0, 0.0)),
    ):
        times_us = [T0 + k * S // hz for k in range(int(seconds * hz))] if hz else []
        made += [(t_us, message((t_us - T0) // 1000 + 60_000)) for t_us in times_us]
    return [Packet(t_us + DELAY_US, frame) for t_us, frame in sorted(made)]


def waited_us(packets, frame_us, pipeline=None):
    """After how long a frame is folded, by what came last; 0: it did not wait."""
    pipeline = pipeline or Pipeline(ONE_UGV)
    last_us = frame_us
    for packet in PacketsInOrder(iter(packets)).awaited(pipeline, frame_us):
        pipeline.add_packet(packet)
        last_us = packet.t_us
    return max(last_us - frame_us, 0)


@pytest.mark.parametrize("ahead_us", [5_000, 35_000, 99_000])
def test_a_frame_waits_until_the_attitude_after_it_has_come(ahead_us):
    frame_us = T0 + DELAY_US + 2 * S - ahead_us
    pipeline = Pipeline(ONE_UGV)
    assert waited_us(heard(4.0), frame_us, pipeline) == ahead_us
    assert not pipeline.fleet.awaits(frame_us)


def test_it_waits_for_the_position_too():
    frame_us = T0 + DELAY_US + 2 * S - 90_000
    assert waited_us(heard(4.0, attitude_hz=50), frame_us) == 90_000


def test_a_recording_waits_for_a_pose_that_comes_seldom():
    frame_us = T0 + 2 * S + 50_000
    assert waited_us(heard(4.0, attitude_hz=2, position_hz=50), frame_us) == 500_000 - 50_000 + DELAY_US


@pytest.mark.parametrize(("late_us", "at_least_us"), [(0, WAIT_US), (200_000, 280_000), (3_000_000, MAX_WAIT_US)])
def test_a_flight_waits_as_long_as_its_radio_is_usually_late(late_us, at_least_us):
    pipeline, speaker = Pipeline(ONE_UGV), MessageEncoder(1)
    for k in range(400):
        made_us = T0 + k * 50_000
        late = late_us * (k % 3 > 0)
        raw = speaker.attitude((made_us - T0) // 1000 + 60_000, 0.0, 0.0, 0.0)
        pipeline.add_packet(Packet(made_us + late, raw))
    assert at_least_us <= pipeline.wait_us <= at_least_us + 20_000


@pytest.mark.parametrize("packets", [[], heard(0.8), heard(4.0, attitude_hz=0)])
def test_it_does_not_wait_for_what_will_not_come(packets):
    frame_us = T0 + 2 * S + DELAY_US
    assert waited_us(packets, frame_us) == 0


def test_it_waits_by_the_clock_of_the_telemetry():
    late = replace(ONE_UGV, clock=Clock(video_offset_s=0.5))
    frame_us = T0 + 2 * S + DELAY_US - 35_000
    assert waited_us(heard(4.0), frame_us, Pipeline(late)) == 0


def test_a_frame_that_is_dated_early_waits_for_what_came_before_it_was_taken():
    early = Pipeline(replace(ONE_UGV, clock=Clock(video_offset_s=-1.5)))
    frame_us = T0 + S
    assert 1.5 * S - 100_000 <= waited_us(heard(4.0), frame_us, early) <= 1.5 * S + WAIT_US
    assert not early.fleet.awaits(early.telemetry_time(frame_us))
