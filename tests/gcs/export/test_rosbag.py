"""ROS 2 bags as rosbags' reader reads them, with the definitions that are in the bag."""

import math
import sys
from collections import defaultdict
from dataclasses import replace

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from gcs.errors import GcsError
from gcs.export.formats import FORMATS
from gcs.export.job import ExportJob
from gcs.snapshot import Event
from mavlink.geodesy import LocalFrame
from tests.support.snapshots import box, snapshot
from vision.video.video import VideoFile

HOSTILE = "A\n'; DROP TABLE messages; --\x00\u202e"


def written(path, snapshots, **job):
    times_us = np.array([shot.t_us for shot in snapshots])
    sink = FORMATS["rosbag"].open(ExportJob(path=path, times_us=times_us, **job))
    for shot in snapshots:
        sink.write(shot)
    sink.close()
    return read(path)


def read(path):
    messages = defaultdict(list)
    with AnyReader([path]) as bag:
        for connection, t_ns, raw in bag.messages():
            messages[connection.topic].append((t_ns, bag.deserialize(raw, connection.msgtype)))
    return messages


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.mark.slow
def test_a_recording_has_detections_pictures_and_fixes(flight, shots, tmp_path):
    taken = shots[::8]
    messages = written(tmp_path / "bag", taken, name="flight", video=flight / "video.mp4")
    times_ns = [1000 * shot.t_us for shot in taken]
    detections = messages["/camera/detections"]
    assert [t_ns for t_ns, _ in detections] == times_ns == [stamp_ns(each) for _, each in detections]
    for shot, (_, each) in zip(taken, detections, strict=True):
        seen = [one for one in shot.new_boxes if not one.coasting]
        assert [(d.bbox.center.position.x, d.bbox.center.theta, d.bbox.size_x) for d in each.detections] == [
            (one.cx, one.angle, one.w) for one in seen
        ]
        named = {r.hypothesis.class_id: r.hypothesis.score for d in each.detections for r in d.results}
        assert named == {shot.name_of(one.system_id): one.confidence for one in seen if one.system_id}
        assert len(named) >= 5
    place = detections[-1][1].detections[0].results[0].pose
    assert place.pose.position.x == taken[-1].new_boxes[0].p_enu[0] and place.covariance[0] > 0.0
    with VideoFile.open(flight / "video.mp4") as film:
        for shot, (t_ns, image) in zip(taken, messages["/camera/image/compressed"], strict=True):
            shown = cv2.imdecode(image.data, cv2.IMREAD_COLOR)
            assert t_ns == 1000 * shot.t_us and image.format == "jpeg"
            assert np.abs(shown.astype(int) - film.read(shot.frame).image).mean() < 6.0
    assert {topic for topic in messages if topic.endswith("/fix")} == {
        f"/vehicles/system_{k}/fix" for k in (1, *range(11, 18))
    }
    fix = messages["/vehicles/system_11/fix"][-1][1]
    row = next(row for row in taken[-1].vehicles if row.system_id == 11)
    lat, lon, alt = taken[-1].origin.to_geodetic(row.p_enu)
    assert (fix.latitude, fix.longitude, fix.altitude) == (lat, lon, alt)
    assert math.sqrt(fix.position_covariance[4]) == pytest.approx(row.std_m)


def test_strangers_and_unsure_names_have_no_hypothesis_and_hostile_words_do_no_harm(tmp_path):
    boxes = [box(1, 2), box(2, 0, runner_up=3), box(3, 3, coasting=True)]
    told = Event(t_us=7, level="warning", kind="text", text=HOSTILE)
    shot = replace(snapshot(0, boxes=boxes, events=[told]), origin=LocalFrame(48.0, 11.0, 500.0))
    rows = tuple(replace(row, name=HOSTILE) if row.system_id == 2 else row for row in shot.vehicles)
    messages = written(tmp_path / "bag", [replace(shot, vehicles=rows)], name=HOSTILE)
    first, second = messages["/camera/detections"][0][1].detections
    name = first.results[0].hypothesis.class_id
    assert name.isprintable() and "DROP TABLE" in name
    assert (second.id, second.results) == ("2", []) and math.isnan(first.results[0].pose.pose.position.x)
    assert messages["/events"][0][1].msg.isprintable() and messages["/events"][0][1].level == 30
    assert not any(topic.endswith("/fix") for topic in messages)


def test_nothing_is_written_over_and_a_missing_library_is_told(tmp_path, monkeypatch):
    (tmp_path / "bag").mkdir()
    with pytest.raises(GcsError, match="exists already"):
        FORMATS["rosbag"].open(ExportJob(path=tmp_path / "bag"))
    sink = FORMATS["rosbag"].open(ExportJob(path=tmp_path / "broken_off"))
    del sink
    assert not (tmp_path / "broken_off").exists()
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    monkeypatch.delitem(sys.modules, "gcs.export.robotics.rosbag")
    with pytest.raises(GcsError, match=r"pip install 'rollcall-gcs\[ros\]'"):
        FORMATS["rosbag"].open(ExportJob(path=tmp_path / "other"))
