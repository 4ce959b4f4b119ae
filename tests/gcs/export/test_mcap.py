"""MCAP as the format's own Python reader reads it, by the schemas in the file; pictures as FFmpeg decodes them."""

import json
import re
import sys
from collections import Counter, defaultdict
from dataclasses import replace

import av
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from gcs.errors import GcsError
from gcs.export.formats import FORMATS, format_for
from gcs.export.job import ExportJob
from gcs.session.frame_tables import read_times
from gcs.snapshot import Event
from mavlink.geodesy import LocalFrame
from tests.support.snapshots import box, snapshot

N = 40
HOSTILE = '<b>"A\u202e\x00,=1+1\n{}'


def read(path):
    """Topic, schema, time and content of each message; every CRC is checked."""
    messages = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                content = _class_of(schema).FromString(message.data)
            messages[channel.topic].append((schema.name, message.log_time, content))
    return messages


def _class_of(schema):
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def pictures(messages):
    """Every message decoded as it comes, as Foxglove does."""
    decoder = av.CodecContext.create("h264", "r")
    decoder.thread_count = 1
    decoder.flags |= av.codec.context.Flags.low_delay
    shown = []
    for _, _, video in messages["/camera/video"]:
        assert video.format == "h264" and video.data.startswith(b"\0\0")
        types = {unit[0] & 31 for unit in re.findall(rb"\x00\x00\x01(.)", video.data, re.DOTALL)}
        assert 5 not in types or 7 in types  # parameters at every key frame
        shown += [frame.to_ndarray(format="gray") for frame in decoder.decode(av.Packet(video.data))]
    return shown + [frame.to_ndarray(format="gray") for frame in decoder.decode(None)]


def written(path, snapshots, **job):
    times_us = np.array([shot.t_us for shot in snapshots])
    sink = format_for(path).open(ExportJob(path=path, times_us=times_us, **job))
    for shot in snapshots:
        sink.write(shot)
    sink.close()
    return read(path)


@pytest.mark.slow
def test_a_recording_has_film_boxes_scene_fixes_and_rows(flight, export_to, tmp_path):
    messages = read(export_to(tmp_path / "a.mcap"))
    export_to(tmp_path / "a.jsonl")
    times_us = read_times(flight / "frames.csv").times_us.tolist()
    for topic in ("/camera/video", "/camera/annotations", "/scene", "/identity"):
        assert [t_ns // 1000 for _, t_ns, _ in messages[topic]] == times_us
    assert {name for name, _, _ in messages["/scene"]} == {"foxglove.SceneUpdate"}
    with av.open(str(flight / "video.mp4")) as film:
        wanted = [frame.to_ndarray(format="gray") for frame in film.decode(video=0)]
    shown = pictures(messages)
    assert len(shown) == N and all(np.array_equal(a, b) for a, b in zip(shown, wanted, strict=True))
    rows = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()[1:]]
    assert [row for _, _, each in messages["/identity"] for row in each["boxes"]] == rows
    boxes = Counter(row["frame"] for row in rows)
    assert [len(each.points) for _, _, each in messages["/camera/annotations"]] == [boxes[k] for k in range(N)]
    assert {text.text.split()[0] for text in messages["/camera/annotations"][-1][2].texts} >= {"UGV-11", "UGV-16"}
    last = {entity.id: entity for entity in messages["/scene"][-1][2].entities}
    place = {f"vehicle-{row['system_id']}": row["enu_m"] for row in rows if row["frame"] == N - 1}
    for one, (east, north, _) in place.items():
        centre = last[one].cubes[0].pose.position
        assert (centre.x, centre.y) == pytest.approx((east, north), abs=0.01)
        assert 1.0 < last[one].cubes[0].size.x < 6.0
    fixes = {topic for topic in messages if topic.startswith("/vehicles/")}
    assert fixes == {f"/vehicles/{k}/fix" for k in (1, *range(11, 18))}
    fix = messages["/vehicles/11/fix"][-1][2]
    mine = next(row for row in rows if row["frame"] == N - 1 and row["system_id"] == 11)
    assert (fix.latitude, fix.longitude) == pytest.approx((mine["lat"], mine["lon"]), abs=5e-5)
    assert fix.position_covariance[0] > 0.0


@pytest.mark.slow_but_first
@pytest.mark.parametrize(("codec", "options"), [("libx264", {"x264-params": "bframes=2:b-adapt=0"}), ("mpeg4", {})])
def test_films_that_cannot_be_shown_as_they_come_are_coded_again(tmp_path, codec, options):
    with av.open(str(tmp_path / "video.mkv"), "w") as film:
        stream = film.add_stream(codec, rate=10, options=options)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for k in range(12):
            grey = np.full((120, 160, 3), 20 + 15 * k, np.uint8)
            film.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="bgr24")))
        film.mux(stream.encode(None))
    notes = []
    shots = [snapshot(frame) for frame in range(12)]
    messages = written(tmp_path / "a.mcap", shots, video=tmp_path / "video.mkv", note=notes.append)
    levels = [float(shown.mean()) for shown in pictures(messages)]
    assert len(levels) == 12 and (np.diff(levels) > 5.0).all()
    assert len(notes) == 1 and "coded again" in notes[0]


@pytest.mark.slow
def test_a_damaged_film_costs_its_damaged_frames(flight, shots, tmp_path):
    data = bytearray((flight / "video.mp4").read_bytes())
    begin = data.find(b"mdat") + 150_000
    data[begin : begin + 40_000] = np.random.default_rng(2).bytes(40_000)
    (tmp_path / "video.mp4").write_bytes(data)
    notes = []
    messages = written(tmp_path / "a.mcap", shots, video=tmp_path / "video.mp4", note=notes.append)
    assert len(notes) == 1 and (
        told := re.fullmatch(r"(\d+) frames of the film are damaged and were left out", notes[0])
    )
    assert len(messages["/camera/video"]) == len(shots) - int(told[1]) > 20
    assert len(messages["/identity"]) == len(shots)
    path = tmp_path / "a.ts"
    sink = format_for(path).open(
        ExportJob(
            path=path,
            video=tmp_path / "video.mp4",
            note=notes.append,
            times_us=np.array([shot.t_us for shot in shots]),
        )
    )
    for shot in shots:
        sink.write(shot)
    sink.close()
    assert notes[1:] == notes[:1]
    with av.open(str(path)) as film:
        assert sum(1 for packet in film.demux(data=0) if packet.size) == len(shots)


def test_strangers_are_nobody_and_what_is_gone_is_taken_away(tmp_path):
    frame, place = LocalFrame(48.0, 11.0, 500.0), np.array([1.0, 2.0, 0.0])
    seen = [box(1, 2, p_enu=place), box(2, 0, p_enu=place, runner_up=3), box(3, 3, p_enu=place, coasting=True)]
    told = Event(t_us=5, level="alarm", kind="text", text=f"UGV says: {HOSTILE}", system_id=2)
    first = replace(snapshot(0, boxes=seen, events=[told]), origin=frame)
    rows = tuple(replace(row, name=HOSTILE, p_enu=place) if row.system_id == 2 else row for row in first.vehicles)
    messages = written(tmp_path / "a.mcap", [replace(first, vehicles=rows), snapshot(1)])
    entities = messages["/scene"][0][2].entities
    assert [entity.id for entity in entities] == ["vehicle-2", "track-2"]
    assert entities[1].texts[0].text == "?" and [pair.key for pair in entities[1].metadata] == [
        "track_id",
        "confidence",
    ]
    assert [gone.id for gone in messages["/scene"][1][2].deletions] == ["track-2", "vehicle-2"]
    shown = entities[0].texts[0].text
    assert shown.startswith('<b>"A\N{REPLACEMENT CHARACTER}') and shown.isprintable()
    log = messages["/log"][0][2]
    assert log.message.isprintable() and log.level == 4 and log.name == "text"
    assert list(messages["/vehicles/2/fix"][0][2].position_covariance) == []
    assert "/vehicles/3/fix" not in messages
    assert messages["/identity"][0][2]["boxes"][1]["name"] is None


def test_without_the_library_it_says_how_to_get_it_and_nothing_is_written_over(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(GcsError, match="exists already"):
        FORMATS["mcap"].open(ExportJob(path=path))
    assert path.read_bytes() == b"mine" and list(tmp_path.iterdir()) == [path]
    monkeypatch.setitem(sys.modules, "foxglove", None)
    monkeypatch.delitem(sys.modules, "gcs.export.robotics.mcap")
    with pytest.raises(GcsError, match=r"pip install 'rollcall-gcs\[foxglove\]'"):
        FORMATS["mcap"].open(ExportJob(path=path))
