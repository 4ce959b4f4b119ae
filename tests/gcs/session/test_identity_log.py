import csv
import json

import numpy as np
import pytest

from gcs.cli.rollcall import print_rollcall
from gcs.errors import GcsError, SessionError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.report.overlay import standing_of
from gcs.report.rollcall import RollCall
from gcs.session.event_log import EventLog
from gcs.session.identity_log import IdentityLog, read_identity
from gcs.session.identity_replay import read_snapshots
from gcs.snapshot import Event
from infra.session_format import IDENTITY
from tests.support.bundled import CURVED_ROAD
from tests.support.command_line import run_gcs
from tests.support.snapshots import TWO_UGVS, box, snapshot
from vision.video.video import VideoFile


def open_export(path):
    return format_for(path).open(ExportJob(path=path, video=path))


def test_rows_have_the_columns_and_unknown_is_empty(tmp_path):
    with IdentityLog(tmp_path) as log:
        log.write(snapshot(0, boxes=[box(1, 2, lat_deg=47.5, lon_deg=8.25), box(2, 0, heading=np.nan)]))
        log.write(snapshot(1, boxes=[box(1, 2, coasting=True), box(0, 0)]))
    lines = (tmp_path / "identity.csv").read_text().splitlines()
    assert lines[0] == IDENTITY.heading
    assert lines[1] == ("1795171704000000,0,1,2,0.9800,10.00,20.00,30.00,15.00,0.5000,2.0000,47.5000000,8.2500000")
    assert lines[2] == "1795171704000000,0,2,,0.9800,20.00,20.00,30.00,15.00,0.5000,,,"
    assert lines[3] == "1795171704100000,1,,,0.9800,0.00,20.00,30.00,15.00,0.5000,2.0000,,"
    assert len(lines) == 4


def test_json_lines_hold_the_evidence(tmp_path):
    full = box(1, 2, runner_up=3, runner_up_confidence=0.01, residual_m=0.4, residual_px=12.0, position_age_s=0.2)
    with IdentityLog(tmp_path) as log:
        log.write(snapshot(boxes=[full]))
    row = json.loads((tmp_path / "identity.jsonl").read_text())
    assert (row["name"], row["runner_up"], row["margin"]) == ("Alpha", 3, pytest.approx(0.97))
    assert (row["residual_m"], row["residual_px"], row["position_age_s"], row["fused"]) == (0.4, 12.0, 0.2, None)


def test_nothing_is_overwritten(tmp_path):
    IdentityLog(tmp_path).close()
    with pytest.raises(SessionError, match="never overwritten"):
        IdentityLog(tmp_path)
    for form in ("csv", "jsonl", "mp4"):
        (tmp_path / f"there.{form}").write_text("kept")
        with pytest.raises(SessionError, match="never overwritten"):
            open_export(tmp_path / f"there.{form}")
        assert (tmp_path / f"there.{form}").read_text() == "kept"
    with pytest.raises(GcsError, match="no export format 'gif'"):
        format_for(tmp_path / "x.csv", "gif")
    with pytest.raises(GcsError, match=r"x\.gif: the ending names no format"):
        format_for(tmp_path / "x.gif")


def test_a_log_read_back_says_the_same(tmp_path):
    before = [snapshot(k, boxes=[box(1, 2), box(2, 0)]) for k in range(3)]
    with IdentityLog(tmp_path) as log:
        for each in before:
            log.write(each)
    assert len(read_identity(tmp_path / "identity.csv")) == 6
    after = list(read_snapshots(tmp_path / "identity.csv", TWO_UGVS, None))
    assert [s.t_us for s in after] == [s.t_us for s in before]
    said = [[(b.track_id, b.system_id, b.cx) for b in s.boxes] for s in after]
    assert said == [[(1, 2, 10.0), (2, 0, 20.0)]] * 3
    assert after[0].name_of(2) == "Alpha"
    assert [standing_of(after[0], b) for b in after[0].boxes] == ["confirmed", "unidentified"]
    own_us = np.array([s.t_us for s in before])
    for times_us in (own_us, own_us + 3_600_000_000, np.append(own_us, own_us[-1] + 1)):
        assert len(list(read_snapshots(tmp_path / "identity.csv", TWO_UGVS, None, times_us=times_us))) == 3
    for times_us in (own_us[:2], own_us + 5_000_000 * (own_us > own_us[1])):
        with pytest.raises(SessionError, match="its frames are not those of this recording"):
            next(read_snapshots(tmp_path / "identity.csv", TWO_UGVS, None, times_us=times_us))


def test_events_keep_hostile_text_as_it_came(tmp_path):
    log = EventLog(tmp_path / "events.jsonl")
    log.write([Event(t_us=1, level="warning", kind="text", text='[/x] "quoted" \\', system_id=2)])
    log.close()
    assert json.loads((tmp_path / "events.jsonl").read_text())["text"] == '[/x] "quoted" \\'


def test_film_export_keeps_the_frames_times(tmp_path):
    sink = open_export(tmp_path / "o.mp4")
    image = np.full((48, 64, 3), 90, np.uint8)
    for frame in (0, 1, 5):
        sink.write(snapshot(frame, boxes=[box(2, 2)], image=image))
    sink.close()
    film = VideoFile.open(tmp_path / "o.mp4")
    assert film.n == 3
    assert np.diff(film.times_us).tolist() == pytest.approx([100_000, 400_000], abs=50)
    film.close()


def test_roll_call_counts_what_was_seen(capsys):
    calls = RollCall(TWO_UGVS)
    for frame in range(4):
        calls.add(snapshot(frame, boxes=[box(1, 2 if frame else 0), box(2, 0)]))
    assert (calls.named, calls.boxes, calls.unnamed) == (1, 8, 5)
    print_rollcall(calls)
    text = capsys.readouterr().out
    assert "Alpha" in text
    assert "75.0%" in text
    assert "never heard" in text
    assert "1 of 2 vehicles named" in text


def test_the_list_of_formats_says_what_opens_them(tmp_path):
    code, told, _ = run_gcs("export", "--list")
    assert code == 0
    rows = told.splitlines()
    assert rows[0].split() == ["format", "ending", "contents", "opened", "by", "extra"]
    assert [row.split()[0] for row in rows[1:]] == list(FORMATS)


@pytest.mark.slow
def test_frames_can_be_thinned(tmp_path):
    code, _, told = run_gcs("export", CURVED_ROAD, "-o", tmp_path / "o.csv", "--every", "100")
    assert (code, told.splitlines()[-1]) == (0, f"gcs: 4 frames written to {tmp_path / 'o.csv'}")
    with (tmp_path / "o.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["frame"] for row in rows} == {"0", "100", "200", "300"}
    assert all(0.5 < float(row["place_std_m"]) < 5.0 for row in rows)
