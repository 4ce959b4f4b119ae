"""Video that the UAV offers: taken only when asked for, told otherwise, and never a file or a device."""

import socket
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.cli.contact import _video
from gcs.flight.flight import Flight
from gcs.flight.plan import FlightPlan
from gcs.flight.video import AUTO, IF_OFFERED, FlightVideo
from gcs.mission.mission import parse_mission
from gcs.session.event_log import VIDEO_AWAITED
from tests.support.ports import free_port
from tests.support.waiting import until

MISSION = {"uav": {"system_id": 1}, "ugv": [{"system_id": 11}]}
RTSP = 0


def offer(uri):
    speaker = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    message = dialect.MAVLink_video_stream_information_message(
        1, 1, RTSP, 1, 30.0, 1280, 720, 2000, 0, 70, b"main", uri.encode()
    )
    return message.pack(speaker)


@pytest.mark.parametrize(
    ("given", "offer", "video"), [(None, "", IF_OFFERED), (None, "rtsp://h/x", AUTO), (AUTO, "", AUTO)]
)
def test_without_a_mission_only_what_is_offered_or_asked_for_is_awaited(given, offer, video):
    listening = SimpleNamespace(offer=offer, hears_video=False)
    assert _video(listening, SimpleNamespace(video=given))[0] == video


@pytest.mark.parametrize(("wanted", "state"), [("", "none"), (IF_OFFERED, "none"), (AUTO, "waiting")])
def test_a_video_is_waited_for_before_an_offer_only_where_it_was_asked_for(wanted, state):
    video = FlightVideo(wanted, None)
    assert video.state == state
    assert [event.text for event in video.check(None)] == [VIDEO_AWAITED] * (state == "waiting")


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("video", "uri", "told", "opened"),
    [
        (AUTO, "rtsp://127.0.0.1:1/main", "the UAV offers video at rtsp://127.0.0.1:1/main", "rtsp://127.0.0.1:1/main"),
        ("", "rtsp://127.0.0.1:1/main", "offers video at rtsp://127.0.0.1:1/main, --video auto shows it", None),
        (AUTO, "file:///etc/passwd", "offers a video that cannot be opened: file:///etc/passwd", None),
        (IF_OFFERED, "file:///etc/passwd", "offers a video that cannot be opened: file:///etc/passwd", None),
    ],
)
def test_an_offer_is_told_and_taken_only_when_asked_for(tmp_path, video, uri, told, opened):
    port = free_port()
    plan = FlightPlan(
        mission=parse_mission(MISSION, "mission"), links=(f"udpin:127.0.0.1:{port}",), video=video, sessions=tmp_path
    )
    flight = Flight(plan)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as uav:

            def is_told():
                uav.sendto(offer(uri), ("127.0.0.1", port))
                return any(told in event.text for event in flight.events())

            assert until(is_told)
        texts = [event.text for event in flight.events()]
        assert sum(told in text for text in texts) == 1, texts
        video = flight._first.video
        assert video.state == ("waiting" if plan.video else "none"), "of what is waited for there is an alarm"
        assert until(lambda: (video.stream.url if video.stream else None) == opened)
    finally:
        flight.stop()
    assert flight.error is None
