"""The bench that folds a flight with faults again and says which alarm each had."""

import struct

import pytest

from bench.faults import main, read_faults
from mavlink.protocol.packet import Packet
from tests.support.flights import T0, S, World

MISSION = "[uav]\nsystem_id = 1\n[[ugv]]\nsystem_id = 11\n[[ugv]]\nsystem_id = 12\n"


class Recorded(World):
    """A flight whose packets are written to a log."""

    def __init__(self, path):
        self._file = path.open("wb")
        super().__init__()

    def feed(self, frame, t_us):
        self._file.write(struct.pack(">Q", t_us) + frame)
        return self.fleet.add_packet(Packet(t_us, frame))

    def close(self):
        self._file.close()


def flown(folder, log):
    """Thirty seconds, rover 12 silent from 10 to 18 s."""
    (folder / "session.toml").write_text(MISSION + "[session]\nformat = 1\n")
    world = Recorded(folder / "telemetry.tlog")
    t_us = world.run(10)
    t_us = world.run(8, start_us=t_us, ids=[1, 11])
    world.run(12, start_us=t_us)
    world.close()
    (folder / "faults.log").write_text(log)
    return folder


def line(seconds, what):
    return f"{T0 / S + seconds:.2f} {what}\n"


SILENT = line(10, "BEGIN stop Bravo(12)") + line(18, "END stop Bravo(12)")


def test_a_fault_with_its_alarm_in_time_and_nothing_else(tmp_path, capsys):
    session = flown(tmp_path, SILENT + line(2, "BEGIN wind UAV(1)") + line(8, "END wind UAV(1)") + "  param 2 ok\n")
    out = tmp_path / "faults.md"
    assert main([str(session), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "| stop | Bravo | 8.0, 16.0 | after" in said and "| no heartbeat |" in said
    assert "2 of 2 faults as they should be; 0 alarms of no fault." in said
    assert said in out.read_text(encoding="utf-8")


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("log", "words"),
    [
        (SILENT.replace("Bravo(12)", "Alpha(11)"), "1 alarms of no fault"),
        (SILENT.replace("stop", "glitch15m"), "0 of 1 faults"),
        (SILENT + line(20, "BEGIN gpsloss UAV(1)") + line(25, "END gpsloss UAV(1)"), "1 of 2 faults"),
    ],
    ids=["an alarm of another vehicle", "an alarm of another kind", "a fault without an alarm"],
)
def test_what_is_not_as_it_should_be_is_told_and_fails(tmp_path, capsys, log, words):
    assert main([str(flown(tmp_path, log))]) == 1
    said = capsys.readouterr().out
    assert words in said


def test_a_fault_that_never_ends_is_refused(tmp_path):
    path = tmp_path / "faults.log"
    path.write_text(line(1, "BEGIN stop Bravo(12)"))
    with pytest.raises(ValueError, match="without an end: stop"):
        read_faults(path)
