"""What Foxglove's viewers receive, by its WebSocket protocol and the schemas that are told in it."""

import base64
import json
import socket
import struct
import sys
import threading
from dataclasses import replace

import aiohttp
import av
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from gcs.errors import GcsError
from gcs.live_out.foxglove_live import FoxgloveLive
from gcs.live_out.sink import SinkSource
from gcs.live_out.sink_url import parse_publish_url
from gcs.snapshot import Alarm
from mavlink.geodesy import LocalFrame
from tests.support.ports import free_port
from tests.support.snapshots import box, snapshot

SOURCE = SinkSource(name="flight")
ALARM = Alarm(key="k", level="alarm", kind="link", text="silent\x1b[2J", advice="look", since_us=1_000_000)
SUBPROTOCOL = "foxglove.sdk.v1"
TOPICS = {
    *("/camera/video", "/camera/annotations", "/scene", "/log", "/identity"),
    *(f"/vehicles/{system_id}/fix" for system_id in (1, 2, 3)),
}


def shown(frame):
    boxes = [box(1, 2, p_enu=np.array([1.0, 2.0, 0.0])), box(2, 0, p_enu=np.zeros(3))]
    flown = snapshot(frame, boxes=boxes, image=np.full((48, 64, 3), 90, np.uint8))
    rows = tuple(replace(row, p_enu=np.array([10.0, 0.0, 0.0])) for row in flown.vehicles)
    return replace(flown, vehicles=rows, origin=LocalFrame(47.0, 8.0), alarms=(ALARM,) if frame > 1 else ())


@pytest.fixture
def flying():
    """The address of a server that is told of a flight."""
    url = parse_publish_url(f"foxglove://127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    sink, stop = FoxgloveLive(url, SOURCE), threading.Event()

    def write():
        frame = 0
        while not stop.wait(0.02):
            frame += 1
            # the alarm goes and comes again, so that whoever is late sees it come too
            sink.write(replace(shown(frame), alarms=(ALARM,) if frame % 20 > 10 else ()))

    writing = threading.Thread(target=write)
    writing.start()
    yield url
    stop.set()
    writing.join(60)
    sink.close()


def reader_of(channel):
    """What makes a message of a channel's bytes."""
    if channel["encoding"] == "json":
        return json.loads
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"])).FromString


async def test_a_viewer_gets_every_channel(flying):
    channels, got = {}, {}
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"ws://{flying.host}:{flying.port}", protocols=[SUBPROTOCOL]) as viewer,
    ):
        while len(got) < len(TOPICS) or len(got["/camera/video"]) < 5:
            message = await viewer.receive(timeout=60)
            if message.type == aiohttp.WSMsgType.TEXT:
                told = json.loads(message.data)
                for channel in told.get("channels", ()) if told["op"] == "advertise" else ():
                    channels[channel["id"]] = channel["topic"], reader_of(channel)
                    wish = {"id": channel["id"], "channelId": channel["id"]}
                    await viewer.send_json({"op": "subscribe", "subscriptions": [wish]})
            else:
                assert message.type == aiohttp.WSMsgType.BINARY, message
                code, subscription, _ = struct.unpack_from("<BIQ", message.data)
                if code == 1:
                    topic, read = channels[subscription]
                    got.setdefault(topic, []).append(read(message.data[13:]))
    assert set(got) == TOPICS
    annotations, identity = got["/camera/annotations"][-1], got["/identity"][-1]
    assert [text.text for text in annotations.texts] == ["Alpha? 98%", "?"]
    assert [row["name"] for row in identity["boxes"]] == ["Alpha", None]
    assert {entity.id for entity in got["/scene"][-1].entities} == {"vehicle-2", "track-2"}
    assert got["/vehicles/2/fix"][-1].latitude == pytest.approx(47.0)
    assert (got["/log"][0].level, got["/log"][0].message) == (4, "silent\ufffd[2J")
    decoder = av.CodecContext.create("h264", "r")
    pictures = [
        picture for each in got["/camera/video"] for picture in decoder.decode(av.Packet(bytes(each.data)))
    ] + decoder.decode(None)
    assert pictures
    assert {(picture.width, picture.height) for picture in pictures} == {(64, 48)}


def test_a_port_that_is_taken_and_a_library_that_is_not_there(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        url = parse_publish_url(f"foxglove://127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(OSError, match="Address already in use"):
            FoxgloveLive(url, SOURCE)
    for address, why in (("192.168.1.2:8765", r"\?open"), ("127.0.0.1:0", "no port")):
        with pytest.raises(GcsError, match=why):
            parse_publish_url(f"foxglove://{address}")
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(GcsError, match=r"pip install 'rollcall-gcs\[foxglove\]'"):
        parse_publish_url("foxglove://127.0.0.1:8765")
