"""How many of the product's files a packet passes, from the socket to its row of the snapshot, and a frame."""

import re
import socket
import sys
from contextlib import contextmanager
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.fold.pipeline import Pipeline
from gcs.fold.snapshot_rows import vehicle_rows
from gcs.mission.mission import Mission, MissionVehicle
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from infra.files.journal import Journal, make_journal
from mavlink.ingest.ingest_memory import IngestMemory, make_ingest_memory
from mavlink.ingest.plan import Signing
from mavlink.ingest.receiver import Receiver, Signatures
from mavlink.links.kinds import parse_url
from mavlink.links.udp import UdpIn
from mavlink.protocol.encoder import COPTER, ROVER, MavlinkEncoder
from mavlink.tlog.writer import TlogWriter
from tests.support.bundled import SWARM, shortened
from tests.support.ports import free_port

ROOT = Path(__file__).parents[3]
CALLERS = {
    "mavlink/ingest/worker.py",
    "mavlink/ingest/ingest.py",
    "gcs/flight/flight.py",
    "gcs/flight/frame_loop.py",
}
"""They call, in loops of their own, what is called here."""
UAV, UGV = 1, 2


def messages(encoder, system_id, boot_ms, lat_e7):
    kind, height_mm = (COPTER, 40_000) if system_id == UAV else (ROVER, 0)
    yield encoder.heartbeat(kind, custom_mode=4)
    yield encoder.attitude(boot_ms, 0.0, 0.0, 0.5)
    yield encoder.pack(
        dialect.MAVLink_gps_raw_int_message(boot_ms * 1000, 3, lat_e7, 1_491_650_000, 584_000, 100, 100, 0, 0, 12)
    )
    yield encoder.pack(
        dialect.MAVLink_global_position_int_message(
            boot_ms, lat_e7, 1_491_650_000 + system_id * 100, 584_000, height_mm, 100, 0, 0, 0
        )
    )


@contextmanager
def noted_files():
    """The product's files of which something is called meanwhile."""
    codes, files = set(), set()

    def note(frame, event, arg):
        if event == "call":
            codes.add(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(before)
        ours = (Path(name) for name in codes if name.startswith(f"{ROOT}/"))
        paths = (path.relative_to(ROOT).as_posix() for path in ours if ".venv" not in path.parts)
        files |= {path for path in paths if not path.startswith("tests/")}


def files_by_the_page(sentence):
    """Number of files that the page tells."""
    (told,) = re.findall(sentence, (ROOT / "docs/architecture.md").read_text(encoding="utf-8"))
    return int(told)


def test_the_page_says_how_many_files_a_packet_passes(tmp_path):
    mission = Mission(uav=MissionVehicle(system_id=UAV), ugv=(MissionVehicle(system_id=UGV),))
    pipeline = Pipeline(mission, links=("udp",))
    link = UdpIn(parse_url(f"udpin:127.0.0.1:{free_port()}"))
    memory = IngestMemory(make_ingest_memory())
    encoders = {system_id: MavlinkEncoder(system_id) for system_id in (UAV, UGV)}
    with (
        TlogWriter(tmp_path / "telemetry.tlog", journal=Journal(make_journal())) as log,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock,
    ):
        receiver = Receiver([link], log, memory, Signatures(Signing()), None)
        sock.connect(("127.0.0.1", link.port))

        def walk(frames):
            for raw in frames:
                sock.send(raw)
            receiver.receive_batch(0, link.read_batch())
            packets = memory.take_packets()
            for packet in packets:
                pipeline.add_packet(packet)
            state = pipeline.fleet.at(packets[-1].t_us)
            pipeline.fleet.take_reports()
            return vehicle_rows(mission, state, (), {}, (0, 0))

        for k in range(4):
            boot_ms = 60_000 + 100 * k
            walk(
                [raw for i, encoder in encoders.items() for raw in messages(encoder, i, boot_ms, -353_630_000 + 10 * k)]
            )
        *_, position = messages(encoders[UGV], UGV, 60_400, -353_629_960)
        with noted_files() as files:
            rows = walk([position])
    link.close()
    assert rows[1].position_state == "ok" and rows[1].position_age_s == 0.0
    files |= CALLERS
    assert all((ROOT / path).is_file() for path in CALLERS)
    assert len(files) <= files_by_the_page(r"A packet passes (\d+) files"), "\n".join(sorted(files))


def test_the_page_says_how_many_files_a_frame_passes(tmp_path, monkeypatch):
    add_frame, passed, named = Pipeline.add_frame, [], []

    def noted(pipeline, *frame, **more):
        with noted_files() as files:
            snapshot = add_frame(pipeline, *frame, **more)
        passed.append(files)
        named.append(sum(box.system_id > 0 for box in snapshot.boxes))
        return snapshot

    monkeypatch.setattr(Pipeline, "add_frame", noted)
    analysis = Analysis(open_session(shortened(SWARM, tmp_path / "flown", 40)))
    try:
        assert len(list(analysis.snapshots(images=False))) == len(passed)
    finally:
        analysis.close()
    assert max(named) > 1
    most = max(passed, key=len)
    assert 60 < len(most) <= files_by_the_page(r"a frame at most (\d+)"), "\n".join(sorted(most))
