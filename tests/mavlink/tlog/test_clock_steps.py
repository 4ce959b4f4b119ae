import struct

import pytest

from infra.wall_clock import ClockWatch
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Packet
from mavlink.tlog.writer import TlogWriter

T0 = 1_790_000_000_000_000
FRAME = MavlinkEncoder(1).attitude(0, 0.1, 0.2, 0.0)


class Clocks:
    """A wall clock that can be set, over a monotonic one that cannot."""

    def __init__(self):
        self.mono_us = 5_000_000
        self.offset_us = T0 - self.mono_us

    def watch(self):
        return ClockWatch(lambda: (self.mono_us + self.offset_us) * 1000, lambda: self.mono_us * 1000)

    @property
    def wall_us(self):
        return self.mono_us + self.offset_us


@pytest.mark.parametrize("step_us", [3_600_000_000, -3_600_000_000, 60_000])
def test_a_clock_that_is_set_is_noted_with_the_first_record_it_stamped(tmp_path, step_us):
    clocks = Clocks()
    writer = TlogWriter(tmp_path / "telemetry.tlog", clock=clocks.watch())

    def stamped():
        clocks.mono_us += 100
        return Packet(clocks.wall_us, FRAME)

    batch = [stamped() for _ in range(3)]
    for each in batch:
        writer.write(each)
    before = [stamped(), stamped()]
    clocks.offset_us += step_us
    after = [stamped()]
    raw = b"".join(struct.pack(">Q", p.t_us) + p.raw for p in before + after)
    assert writer.write_records(raw, 3) == 3
    clocks.offset_us += 40_000
    writer.write(stamped())
    writer.close()
    assert writer.state.clock_step_s == pytest.approx(step_us * 1e-6)
    assert (tmp_path / "clock.csv").read_text() == (
        f"record,t_us,offset_us,step_us\n5,{clocks.wall_us - 40_100},{clocks.offset_us - 40_000},{step_us}\n"
    )


def test_a_reading_of_the_clocks_that_was_interrupted_is_no_step():
    clocks = Clocks()
    watch = clocks.watch()
    pause_us = 200_000

    def wall_ns():
        clocks.mono_us += pause_us
        return clocks.wall_us * 1000

    watch._wall_ns = wall_ns
    assert watch.stepped() is None
    pause_us = 0
    assert watch.stepped() is None
