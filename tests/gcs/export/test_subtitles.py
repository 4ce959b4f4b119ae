from dataclasses import replace

import numpy as np
import pysubs2
import pytest
import webvtt

from gcs.errors import SessionError
from gcs.export.formats import format_for
from gcs.export.job import ExportJob
from gcs.session.frame_tables import read_times
from tests.support.snapshots import box, snapshot

UNEVEN_US = np.array([0, 40_000, 100_000, 133_333, 600_000, 640_000], dtype=np.int64)
HOSTILE = r"{\pos(1,1)}<b>A\N&B --> C"


def written(path, snapshots, times_us=UNEVEN_US):
    sink = format_for(path).open(ExportJob(path=path, name="a flight", times_us=times_us))
    for each in snapshots:
        sink.write(each)
    sink.close()
    return path


def named(frame, *boxes):
    shot = snapshot(frame, boxes=boxes or [box(1, 2, cx=300.0, cy=200.0)])
    return replace(shot, width=640, height=480)


def renamed(shot, name):
    rows = [replace(row, name=name) if row.system_id == 2 else row for row in shot.vehicles]
    return replace(shot, vehicles=tuple(rows))


def milliseconds(clock):
    hours, minutes, seconds = clock.split(":")
    return round(1000 * (3600 * int(hours) + 60 * int(minutes) + float(seconds)))


def spans(path):
    """Distinct start and end of the cues, ms, as another's reader has them."""
    if path.suffix == ".vtt":
        return sorted({(milliseconds(cue.start), milliseconds(cue.end)) for cue in webvtt.read(path)})
    return sorted({(line.start, line.end) for line in pysubs2.load(str(path))})


def test_each_cue_ends_where_the_next_frame_begins(tmp_path):
    shots = [named(frame) for frame in range(len(UNEVEN_US))]
    for suffix, tick_us in (("srt", 1_000), ("vtt", 1_000), ("ass", 10_000)):
        found = spans(written(tmp_path / f"a.{suffix}", shots))
        begins = [us // tick_us * tick_us // 1000 for us in UNEVEN_US.tolist()]
        assert [start for start, _ in found] == begins
        assert [end for _, end in found[:-1]] == begins[1:]
        assert found[-1][1] > begins[-1]


def test_names_stay_through_frames_that_nothing_looked_at_and_go_with_those_that_show_nothing(tmp_path):
    unlooked = replace(named(3), seen_us=named(2).t_us)
    shots = [named(0), snapshot(1), named(2), unlooked, snapshot(4), named(5, box(1, 2, coasting=True))]
    assert spans(written(tmp_path / "a.srt", shots)) == [(0, 40), (100, 600)]


def test_hostile_names_are_letters(tmp_path):
    shots = [renamed(named(0), HOSTILE), renamed(named(1), HOSTILE)]
    for suffix in ("ass", "srt"):
        line = pysubs2.load(str(written(tmp_path / f"a.{suffix}", shots)))[0]
        assert "B --" in line.plaintext and "pos" in line.plaintext  # neither an order nor a line end
        assert "\n" not in line.plaintext and line.text.count("\\pos") == (suffix == "ass")
    captions = list(webvtt.read(written(tmp_path / "a.vtt", shots)))
    assert len(captions) == 2
    assert captions[0].raw_text == r"{\pos(1,1)}&lt;b&gt;A\N&amp;B --&gt; C? 98%"


def test_strangers_are_counted_and_never_named(tmp_path):
    shots = [named(0, box(1, 2, cx=100.0), box(2, 0, cx=400.0, runner_up=3, runner_up_confidence=0.4)), named(1)]
    srt, ass, vtt = (written(tmp_path / f"a.{suffix}", shots) for suffix in ("srt", "ass", "vtt"))
    assert pysubs2.load(str(srt))[0].plaintext == "Alpha? 98%   1 ?"
    assert sorted(line.plaintext for line in pysubs2.load(str(ass)) if line.start == 0) == ["?", "Alpha? 98%"]
    assert sorted(each.text for each in webvtt.read(vtt) if each.start == "00:00:00.000") == ["?", "Alpha? 98%"]


@pytest.mark.slow
def test_a_recording_has_its_names_beside_its_vehicles(flight, export_to, tmp_path):
    for suffix in ("ass", "srt", "vtt"):
        export_to(tmp_path / f"a.{suffix}")
        with pytest.raises(SessionError, match="exists already"):
            export_to(tmp_path / f"a.{suffix}")
    times_us = read_times(flight / "frames.csv").times_us
    begins = np.array([start for start, _ in spans(tmp_path / "a.ass")])
    assert len(begins) == 40
    assert np.abs(begins - (times_us - times_us[0]) / 1000).max() < 11
    names = {f"UGV-{k}" for k in range(11, 17)}
    lines = list(pysubs2.load(str(tmp_path / "a.ass")))
    # not sure yet at first
    last = max(line.start for line in lines)
    assert names <= {line.plaintext.split()[0] for line in lines if line.start == last}
    first = [each.text.split()[0] for each in webvtt.read(tmp_path / "a.vtt") if each.start == "00:00:00.000"]
    assert {name.rstrip("?") for name in first} == names
