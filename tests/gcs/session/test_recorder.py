import errno
import json
import logging
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from gcs.errors import SessionError
from gcs.health.faults import Faults
from gcs.health.station_alarms import STALLED_S
from gcs.mission.mission import Mission, MissionVehicle
from gcs.session.fold_order import FoldOrder, FoldTurn
from gcs.session.frame_tables import read_detections, read_motions, read_times
from gcs.session.line_file import LineFile
from gcs.session.recorder import Recorder, RecordingEvents
from gcs.session.session import open_session
from gcs.session.tables import read_table
from gcs.snapshot import Box, Event, Health, Snapshot
from infra.files.record_state import RecordState, overall
from infra.files.segment import segments
from infra.session_format import IDENTITY
from mavlink.protocol.packet import Packet
from tests.support.faulty_disk import FaultyDisk, HangingDisk, WholeRecorder, delete
from tests.support.frames import FRAMES, T0, packet, records
from tests.support.waiting import until
from vision.detect.detections import Detections
from vision.motion.image_motion import ImageMotion

MISSION = Mission(
    uav=MissionVehicle(system_id=1), ugv=(MissionVehicle(system_id=2, name="Alpha"), MissionVehicle(system_id=3))
)
TABLES = (
    "identity.csv",
    "frames.csv",
    "detections.csv",
    "looks.csv",
    "motion.csv",
    "folds.csv",
    "unfolded.csv",
)
TEXTS = (*TABLES, "identity.jsonl", "events.jsonl")


def boxes(frame):
    column = np.full(2, 0.5)
    names = ("cx", "cy", "w", "h", "angle", "score", "heading")
    looked = np.array([[0.0, 0.0, 4.0 + frame / 3, 8.0]])
    return Detections(**{name: column + k + frame for k, name in enumerate(names)}, looked=looked)


def snapshot(frame):
    place = {"cx": 10.0 + frame, "cy": 20.0, "w": 30.0, "h": 15.0, "angle": 0.5, "heading": 2.0, "score": 0.9}
    t_us = T0 + 100_000 * frame
    return Snapshot(
        t_us=t_us,
        frame=frame,
        width=64,
        height=48,
        image=None,
        vehicles=(),
        boxes=(Box(track_id=1, system_id=2, confidence=0.98, **place),),
        footprint_enu=None,
        uav_enu=np.zeros(3),
        uav_heading=0.0,
        health=Health(),
        events=(Event(t_us=t_us, level="info", kind="text", text=f"frame {frame}"),),
    )


def fly(recorder, frames):
    """One packet, frame, two boxes, an identity and an event for each frame."""
    for frame in frames:
        recorder.packet(packet(frame))
        recorder.frame_time(frame, T0 + 100_000 * frame)
        recorder.detections(frame, boxes(frame))
        recorder.motion(frame, ImageMotion(H=np.eye(3) + 1e-3 * frame, std_px=0.1, inliers=90, share=0.75))
        recorder.fold(
            FoldTurn(
                frame=frame,
                t_us=T0 + 100_000 * frame,
                records=frame + 1,
                record_us=T0 + frame,
                heard_us=0,
                boxes=2,
                size=(64, 48),
            )
        )
        recorder.unfolded(frame, 1)
        recorder.snapshot(snapshot(frame))
    assert all(file.settle(60.0) for file in recorder._files), "the system has it, or has refused it"


def complete(folder, frames):
    """Everything of every frame can be read, and once only."""
    assert read_times(folder / "frames.csv").times_us.tolist() == [T0 + 100_000 * k for k in range(frames)]
    seen = read_detections(folder / "detections.csv")
    assert [seen.at(k).cx.tolist() for k in range(frames)] == [[k + 0.5] * 2 for k in range(frames)]
    assert [seen.at(k).looked.tolist() for k in range(frames)] == [boxes(k).looked.tolist() for k in range(frames)]
    motions = read_motions(folder / "motion.csv")
    assert [motions.at(k).H[0, 1] for k in range(frames)] == [1e-3 * k for k in range(frames)]
    folds = FoldOrder.read(folder)
    assert [turn.frame for turn in folds.turns] == list(range(frames))
    assert not folds.taken_in(frames).any() and folds.taken_in(frames + 1)[frames]
    table = read_table(folder / "identity.csv", IDENTITY)
    assert table["frame"].tolist() == list(range(frames))
    for name, key in (("events.jsonl", "text"), ("identity.jsonl", "frame")):
        rows = [json.loads(line) for part in segments(folder / name) for line in part.read_text().splitlines()]
        assert len({row[key] for row in rows}) == frames


@pytest.fixture
def disk():
    return FaultyDisk()


@pytest.fixture
def recorder(tmp_path, disk, monkeypatch):
    # the disk under the tests may itself be slow, which is an event that no test here asks for
    monkeypatch.setattr("gcs.session.recorder.SLOW_S", 60.0)
    recorder = WholeRecorder(tmp_path, MISSION, video=True, disk=disk)
    yield recorder
    recorder.close()


def alarms(recorder):
    return [event.text for event in recorder.check() if event.level == "alarm"]


def notes(recorder):
    return tomllib.loads((recorder.folder / "session.toml").read_text())["session"]


def test_a_flight_without_faults(recorder):
    fly(recorder, range(20))
    assert recorder.check() == ()
    assert recorder.bytes > 1000
    assert "ended" not in notes(recorder)
    assert recorder.close() == ()
    complete(recorder.folder, 20)
    assert notes(recorder)["packets"] == 20
    assert "ended" in notes(recorder)
    session = open_session(recorder.folder)
    assert (session.frames, session.detections) == (recorder.folder / "frames.csv", recorder.folder / "detections.csv")


@pytest.mark.slow_but_first
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_a_full_disk_never_stops_the_flight_and_costs_nothing(recorder, disk, code):
    fly(recorder, range(10))
    disk.room, disk.write_error = 25, code
    fly(recorder, range(10, 400))
    told = alarms(recorder)
    for name in ("telemetry.tlog", *TEXTS):
        assert any(text.startswith(f"{name}: cannot be written: ") for text in told)
        lines = (recorder.folder / name).read_bytes()
        assert name == "telemetry.tlog" or lines.endswith(b"\n"), "whole lines only"
    assert alarms(recorder) == [], "told once"
    disk.room, disk.write_error = None, 0
    assert until(lambda: not any(state.failing_s for state in recorder.states().values()))
    assert sum(event.text.endswith(": written again") for event in recorder.check()) == 1 + len(TEXTS)
    fly(recorder, range(400, 410))
    assert recorder.close() == ()
    complete(recorder.folder, 410)


def test_a_failing_disk_leaves_segments_that_read_as_one(recorder, disk):
    fly(recorder, range(10))
    disk.sync_error = errno.EIO
    assert until(lambda: all(state.faults for state in recorder.states().values()))
    fly(recorder, range(10, 20))
    disk.sync_error = 0
    assert until(lambda: not any(state.failing_s for state in recorder.states().values()))
    assert any("Input/output error" in text for text in alarms(recorder))
    fly(recorder, range(20, 30))
    disk.room, disk.write_error = 0, errno.EIO
    fly(recorder, range(30, 40))
    disk.room, disk.write_error = None, 0
    assert until(lambda: not any(state.failing_s for state in recorder.states().values()))
    assert recorder.close() == ()
    assert (recorder.folder / "detections.1.csv").read_text().startswith("frame,cx,cy,w,h,angle,score,heading\n")
    complete(recorder.folder, 40)


def goes_on(recorder, take_away):
    """The folder is taken away in flight; all that was recorded is in it at the end."""
    fly(recorder, range(10))
    take_away(recorder.folder)
    fly(recorder, range(10, 20))
    assert until(lambda: all((recorder.folder / name).exists() for name in ("telemetry.tlog", *TEXTS)))
    assert sum("deleted or moved while it was written" in text for text in alarms(recorder)) == 1 + len(TEXTS)
    fly(recorder, range(20, 30))
    assert recorder.close() == ()
    complete(recorder.folder, 30)
    assert (recorder.folder / "telemetry.tlog").read_bytes() == records(30)


def test_a_deleted_session_is_made_anew(recorder):
    goes_on(recorder, delete)
    assert notes(recorder)["packets"] == 30


def test_a_session_that_was_moved_away_is_whole_where_it_belongs(recorder, tmp_path):
    """A folder after an unmount by force: the files can still be written, and nobody would find them."""
    goes_on(recorder, lambda folder: folder.rename(tmp_path / "elsewhere"))


def test_what_is_lost_at_the_end_is_said_and_kept_in_the_session(recorder, disk):
    fly(recorder, range(10))
    disk.room = 0
    fly(recorder, range(10, 15))
    lost = recorder.close()
    assert "telemetry.tlog: 5 rows lost: No space left on device" in lost
    assert notes(recorder)["lost"]["telemetry.tlog"] == 5
    assert notes(recorder)["lost"]["detections.csv"] == 10


def test_telemetry_may_be_another_processs_business(tmp_path):
    recorder = Recorder(tmp_path, MISSION, video=False)
    assert not recorder.tlog_path.exists()
    state = RecordState(name="telemetry.tlog", rows=77, failing_s=0.3, reason="No space left on device", faults=1)
    told = recorder.check(state)
    assert [event.text for event in told if event.level == "alarm"] == [
        "telemetry.tlog: cannot be written: No space left on device; kept in memory until it can"
    ]
    recorder.close(RecordState(name="telemetry.tlog", rows=78))
    assert notes(recorder)["packets"] == 78


def test_a_recording_that_cannot_begin_leaves_nothing(tmp_path, disk):
    disk.open_error = errno.ENOSPC
    with pytest.raises(SessionError, match="cannot be made: No space left on device"):
        Recorder(tmp_path / "sessions", MISSION, video=True, disk=disk)
    assert list((tmp_path / "sessions").iterdir()) == []


def test_a_disk_that_hangs_holds_up_neither_the_flight_nor_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr("gcs.session.line_file.HANG_S", 1.0)
    disk = HangingDisk()
    recorder = Recorder(tmp_path, MISSION, video=True, disk=disk)
    recorder.snapshot(snapshot(0))
    assert recorder.check() == ()
    disk.may_write.clear()
    for k in range(1, 50):
        recorder.frame_time(k, T0 + k)
        recorder.detections(k, boxes(k))
        recorder.snapshot(snapshot(k))
    written = ("frames.csv", "detections.csv", "identity.csv", "identity.jsonl", "events.jsonl")
    assert until(lambda: all(recorder.states()[name].stalled_s > STALLED_S for name in written))
    assert recorder.check() == (), "the alarm tells it, for all files"
    assert all(recorder.states()[name].waiting >= 49 for name in written), "the flight went on without the disk"
    assert len((recorder.folder / "events.jsonl").read_text().splitlines()) == 1
    disk.may_write.set()
    assert until(lambda: not any(state.waiting for state in recorder.states().values()))
    assert recorder.check() == ()
    disk.may_write.clear()
    recorder.snapshot(snapshot(50))
    assert until(lambda: recorder.states()["identity.csv"].stalled_s > 0.0)
    lost = recorder.close()
    names = {line.partition(":")[0] for line in lost}
    assert names == {"identity.csv", "identity.jsonl", "events.jsonl"}, "it closed without waiting for the disk"
    assert "ended" not in notes(recorder), "the next start seals it"
    disk.may_write.set()


def test_no_file_is_ever_overwritten(tmp_path):
    LineFile(tmp_path / "a.csv").close()
    with pytest.raises(SessionError, match="File exists"):
        LineFile(tmp_path / "a.csv")


def test_hostile_text_is_recorded_and_stops_nothing(tmp_path):
    file = LineFile(tmp_path / "a.jsonl")
    file.write("\ud800\n")
    file.write("")
    file.close()
    assert (tmp_path / "a.jsonl").read_text() == "?\n"


def state(**values):
    return {"a.csv": RecordState(name=values.pop("name", "a.csv"), **values)}


def test_every_fault_is_told_once_with_its_end():
    watch = RecordingEvents()
    full = {"failing_s": 0.1, "reason": "full", "faults": 1}
    story = [
        (state(), []),
        (state(**full), [("alarm", "a.csv: cannot be written: full; kept in memory until it can")]),
        (state(**full | {"failing_s": 1.1}), []),
        (state(**full, lost=3), [("alarm", "a.csv: 3 rows lost: full")]),
        (state(**full, lost=4), []),
        (state(**full, lost=6), [("alarm", "a.csv: 6 rows lost: full")]),
        (state(reason="full", faults=1, lost=6), [("info", "a.csv: written again")]),
        (state(reason="full", faults=1, lost=6, sync_age_s=2.5), [("warning", None)]),
        (state(reason="full", faults=1, lost=6, sync_age_s=9.5), []),
        (state(reason="full", faults=1, lost=6), [("info", "a.csv: disk keeps up again")]),
        (
            state(reason="bad", faults=2, lost=6, name="a.1.csv"),
            [
                ("alarm", "a.csv: cannot be written: bad; kept in memory until it can"),
                ("info", "a.csv: written again, goes on in a.1.csv"),
            ],
        ),
        (state(name="a.2.csv"), []),
        (state(name="a.2.csv", lost=1), [("alarm", "a.csv: 1 rows lost")]),
    ]
    for now, told in story:
        events = watch.update(T0, now)
        assert [event.level for event in events] == [level for level, _ in told]
        assert [event.text for event, (_, text) in zip(events, told, strict=True) if text] == [t for _, t in told if t]


def test_a_fault_that_is_over_keeps_the_reason_of_the_file_that_had_it():
    log = RecordState(name="telemetry.tlog", rows=5, reason="full", faults=1, failed_ago_s=60.0)
    senders = RecordState(name="senders.csv", reason="bad", faults=1, failed_ago_s=0.1)
    assert overall((log, senders)).reason == "senders.csv: bad"
    assert overall((replace(log, failed_ago_s=0.05), senders)).reason == "full"
    never = RecordState(name="telemetry.tlog")
    told = RecordingEvents().update(T0, {"telemetry": overall((never, senders))})
    assert [event.text for event in told] == [
        "telemetry: cannot be written: senders.csv: bad; kept in memory until it can",
        "telemetry: written again",
    ]
    assert overall((never, never)).reason == "" == overall((never, never)).because


def test_a_kept_packet_keeps_its_time(tmp_path):
    recorder = WholeRecorder(tmp_path, MISSION, video=False)
    recorder.packet(Packet(time.time_ns() // 1000, FRAMES[0]))
    recorder.close()
    assert not (recorder.folder / "clock.csv").exists()
    assert not (recorder.folder / "refused.csv").exists()


def test_the_program_log_of_a_session_has_events_and_faults(tmp_path):
    recorder = Recorder(tmp_path, MISSION, video=False)
    recorder.events((Event(t_us=T0, level="alarm", kind="link", text="14550: gone"),))
    Faults(recorder.folder / "faults.txt").record("naming", ValueError("odd"))
    recorder.close()
    logging.getLogger("gcs").error("after the flight")
    text = (recorder.folder / "program.log").read_text()
    assert "link: 14550: gone" in text
    assert "fault while naming" in text
    assert "ValueError: odd" in text
    assert "after the flight" not in text
