"""The screen before a flight without a mission file, on a small terminal."""

from types import SimpleNamespace

import pytest

from gcs.flight import devices
from gcs.mission.roster import HeardVehicle, mission_of
from gcs.tui.panes.key_hints import KeyHints
from gcs.tui.start_app import HINTS, StartApp
from infra.wall_clock import now_us
from mavlink.errors import LinkError
from mavlink.protocol.encoder import COPTER, ROVER
from mavlink.protocol.packet import Auth
from tests.support.fake_station import HOSTILE

SMALL = (80, 24)


def vehicle(system_id, kind, **known):
    t_us = now_us()
    heard = HeardVehicle(system_id=system_id, link=0, type=kind, autopilot=3, **known)
    heard.positions.extend(range(t_us - 1_000_000, t_us + 1, 200_000))
    return heard


def air(*vehicles, offer="", hears_video=False, troubles=()):
    return SimpleNamespace(
        roster=SimpleNamespace(vehicles=vehicles),
        offer=offer,
        hears_video=hears_video,
        troubles=troubles,
        links=("udpin:0.0.0.0:14550",),
        where="UDP 14550, 14540, 14551",
        began_us=now_us() - 8_000_000,
        poll=lambda timeout_s: None,
    )


COPTER_1, ROVERS = vehicle(1, COPTER), tuple(vehicle(i, ROVER) for i in (11, 12, 13))


async def press(listening, *keys, chosen=None):
    """The app and its last screen as text after some keys; the app has ended where it flies."""
    app = StartApp(listening, chosen or {})
    async with app.run_test(size=SMALL) as pilot:
        for key in keys:
            await pilot.press(key)
            await pilot.pause()
        table = app.query_one("#panes") if app.is_running and len(app.screen_stack) == 1 else None
        lines = [] if table is None else [table.render_line(y).text for y in range(table.size.height)]
    return app, "\n".join(lines)


async def test_every_key_but_the_arrows_is_in_the_last_row():
    app = StartApp(air(COPTER_1, *ROVERS), {})
    async with app.run_test(size=SMALL):
        last = app.query_one(KeyHints).render_line(0).text
    assert [key for key, word in HINTS if key != "↑↓" and f" {key} {word} " not in last] == []


async def test_the_first_row_is_picked_until_the_operator_picks():
    heard = air(ROVERS[2])
    app = StartApp(heard, {})

    async def picked(*keys):
        for key in keys:
            await pilot.press(key)
        app._poll()
        await pilot.pause()
        table = app.query_one("#panes")
        lines = [table.render_line(y).text for y in range(table.size.height)]
        return next(line.split()[2] for line in lines if line.startswith("▌"))

    async with app.run_test(size=SMALL) as pilot:
        assert await picked() == "13"
        heard.roster.vehicles = (COPTER_1, *ROVERS[1:])
        assert await picked() == "1" and await picked("down") == "12"
        heard.roster.vehicles = (COPTER_1, *ROVERS)
        assert await picked() == "12"


async def test_enter_flies_with_who_is_heard():
    app, _ = await press(air(COPTER_1, *ROVERS), "enter")
    mission = mission_of(app.found.roles, app.found.names)
    assert (mission.uav.system_id, mission.ugv_ids, app.found.video) == (1, (11, 12, 13), None)


@pytest.mark.parametrize(
    ("vehicles", "keys", "roles"),
    [
        # one is left out, and taken in again
        ((COPTER_1, *ROVERS), ["down", "space"], {1: "films", 11: "out", 12: "named", 13: "named"}),
        ((COPTER_1, *ROVERS), ["down", "space", "space"], {1: "films", 11: "named", 12: "named", 13: "named"}),
        # of two aircraft the picked one films; the other one is no ground vehicle
        ((COPTER_1, vehicle(2, COPTER), *ROVERS[:1]), ["j", "f"], {1: "out", 2: "films", 11: "named"}),
        ((COPTER_1, vehicle(2, COPTER), *ROVERS[:1]), ["j", "f", "up", "f"], {1: "films", 2: "out", 11: "named"}),
        # who is refused stays out until the operator says otherwise
        ((COPTER_1, ROVERS[0], vehicle(14, ROVER, auth=Auth.UNSIGNED)), [], {1: "films", 11: "named", 14: "out"}),
    ],
)
async def test_keys_change_what_a_vehicle_is(vehicles, keys, roles):
    app, _ = await press(air(*vehicles), *keys, "enter")
    assert app.found is not None and dict(app.found.roles) == roles


@pytest.mark.parametrize(
    ("vehicles", "told"),
    [
        ((), "Nobody is heard yet: have the vehicles send their telemetry here."),
        (ROVERS, "No aircraft films: pick the one that does, and press f."),
        ((COPTER_1,), "No ground vehicle is named: one that is heard is taken in by space."),
        ((COPTER_1, vehicle(2, COPTER), *ROVERS), "2 aircraft: pick the one that films, and press f."),
        ((COPTER_1, *ROVERS), "enter flies: vehicle 1 films, 3 are named."),
    ],
)
async def test_the_screen_says_what_is_still_to_be_done(vehicles, told):
    app, text = await press(air(*vehicles))
    assert ("films?" in text) == (told.startswith("2 aircraft"))
    assert told in text and "listening on UDP 14550, 14540, 14551" in text and app.found is None
    if "enter flies" not in told:
        assert (await press(air(*vehicles), "enter"))[0].found is None


async def test_a_name_is_typed_and_another_ones_refused():
    app, _ = await press(air(COPTER_1, *ROVERS), "down", "r", "ctrl+u", "T", "o", "m", "enter", "enter")
    assert app.found.names == {11: "Tom"}
    app, _ = await press(air(COPTER_1, *ROVERS), "down", "r", "ctrl+u", "U", "A", "V", "enter", "enter")
    assert app.found is None and app._names == {}


@pytest.mark.parametrize(
    ("listening", "told"),
    [
        (air(COPTER_1), "none offered, and none heard on UDP 5600 yet"),
        (air(COPTER_1, hears_video=True), "heard at udp://:5600"),
        (air(COPTER_1, offer="rtsp://u:secret@192.168.1.10/main"), "offered by the UAV: rtsp://"),
    ],
)
async def test_the_video_is_told_without_its_password(listening, told):
    _, text = await press(listening)
    assert told in text and "secret" not in text


async def test_a_port_that_another_program_has_is_told_whole(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    taken = "udpin:0.0.0.0:14550: UDP port 14550 is in use by process 5432 (QGroundControl); stop it or use another"
    _, text = await press(air(troubles=(taken,)))
    assert taken in " ".join(text.split()) and "mission.toml is here" not in text
    (tmp_path / "mission.toml").touch()
    assert "mission.toml is here: gcs fly mission.toml flies that one" in (await press(air()))[1]


@pytest.mark.parametrize("text", HOSTILE)
async def test_nothing_that_is_heard_is_markup(text):
    app, drawn = await press(air(COPTER_1, *ROVERS, offer=text))
    assert "enter flies" in drawn and not any(ord(c) < 32 for c in drawn.replace("\n", "")), drawn
    assert app.found is None


async def test_more_vehicles_than_rows_follow_the_picked_one():
    many = (COPTER_1, *(vehicle(i, ROVER) for i in range(11, 51)))
    _, text = await press(air(*many), *["down"] * 40)
    assert "UGV-50" in text and "UGV-11" not in text and "40 are named" in text


@pytest.fixture
def plugged_in(tmp_path, monkeypatch):
    """A computer with two serial ports, and a camera that has two devices."""
    monkeypatch.setattr(devices, "DEV", tmp_path / "dev")
    monkeypatch.setattr(devices, "CLASSES", tmp_path / "classes")
    (tmp_path / "dev").mkdir()
    for name in ("ttyUSB0", "ttyACM0", "ttyS0", "video0", "video1"):
        (tmp_path / "dev" / name).touch()
    for index, name in enumerate(("video0", "video1")):
        (tmp_path / "classes" / name).mkdir(parents=True)
        (tmp_path / "classes" / name / "index").write_text(f"{index}\n")
        (tmp_path / "classes" / name / "name").write_text("[b]Cam[/b]\n")
    return tmp_path / "dev"


async def test_a_serial_port_is_offered_and_opened_only_after_a_question(plugged_in):
    asked, listening = [], air()

    def add_link(url):
        asked.append(url)
        if "ACM" in url:
            raise LinkError("it is not free")
        listening.links = (*listening.links, url)

    listening.add_link = add_link
    _, text = await press(listening)
    radio, autopilot = f"{plugged_in}/ttyUSB0,57600", f"{plugged_in}/ttyACM0,115200"
    assert devices.serial_links() == (autopilot, radio) and "s listens to it" in text and not asked
    await press(listening, "s")
    await press(listening, "s", "escape")
    assert not asked
    _, text = await press(listening, "s", "enter")
    assert asked == [autopilot] and not text, "the question stays where a port cannot be opened"
    (plugged_in / "ttyACM0").unlink()
    _, text = await press(listening, "s", "enter")
    assert asked[1:] == [radio] and "(here: none)" in text


async def test_a_camera_that_is_plugged_in_is_offered_where_no_video_comes(plugged_in):
    assert devices.cameras() == {f"{plugged_in}/video0": "[b]Cam[/b]"}
    app, _ = await press(air(COPTER_1, *ROVERS), "v", "enter", "enter")
    assert app.found.video == f"{plugged_in}/video0"
    app, _ = await press(air(COPTER_1, *ROVERS, hears_video=True), "v", "enter", "enter")
    assert app.found.video is None
