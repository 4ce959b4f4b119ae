"""A station that stands still, with everything that an operator may meet, and the terminal application driven on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs.snapshot import Alarm, Box, Event, Health, LinkHealth, Snapshot, Standing, VehicleRow
from gcs.station import CameraPicture, Gap
from gcs.trails import Trails
from gcs.tui import RollcallApp
from gcs.tui.pane_area import PaneArea
from gcs.tui.panes.pane import Pane

START_US = 1_795_170_792_000_000  # 2026-11-20 10:33:12 UTC
STOP_US = START_US + 754_000_000
HOSTILE = (
    "[/x]",
    "[@click=app.quit]x[/]",
    "\x1b[2J\x1b]0;pwned\x07\x1b[31mred",
    "a\r\nb\tc\x00\x9b31m",
    "\u202eesrever\u2066",
    "[bold red]x[/bold red] [link=http://x]",
    "\ufffd\ud800 \U0001f916 漢字 e\u0301",
    "{}%s{0}$(x)`x`\\",
    "\x1b]52;c;cm0gLXJmIH4=\x07\x1bPq#0~\x1b\\",
    "zero\u200bwidth\u200d\u2060\ufeff\u00ad\u034f \ue000\U0010ffff\U000e0041",
    "\U0001f468\u200d\U0001f469\u200d\U0001f467 \U0001f1e9\U0001f1ea a" + "\u0300" * 60,
    "W" * 100_000,
    "\u2028\u2029\x85\x0b\x0c\x1c",
    "",
)
WIDTH, HEIGHT = 1280, 720
NAN = math.nan

# system id, east, north, heading (deg), standing, confidence, position state, position age
FLEET: tuple[tuple[int, float, float, float, Standing, float, str, float], ...] = (
    (11, -14.0, 8.0, 40.0, "confirmed", 0.97, "ok", 0.2),
    (12, -3.0, 3.5, 95.0, "confirmed", 0.99, "ok", 0.1),
    (13, 4.0, 9.0, 180.0, "tentative", 0.61, "stale", 1.4),
    (14, 12.0, -5.0, 300.0, "coasting", 0.88, "ok", 0.3),
    (15, 16.0, 5.0, 220.0, "unidentified", NAN, "ok", 0.4),
    (16, 42.0, 21.0, 10.0, "out of view", NAN, "ok", 0.2),
    (17, NAN, NAN, NAN, "no position", NAN, "lost", 12.0),
)


@cache
def texture() -> NDArray[np.uint8]:
    """(720, 1280, 3) dry ground with a road, the same on every machine."""
    rng = np.random.default_rng(7)
    coarse = cv2.resize(rng.random((9, 16)).astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    fine = cv2.resize(rng.random((90, 160)).astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
    light = (58 + 52 * coarse + 22 * fine)[..., None]
    image = np.clip(light * np.array([0.72, 0.98, 1.06]), 0, 255).astype(np.uint8)
    cv2.line(image, (0, 560), (1280, 250), (112, 116, 120), 74)
    cv2.line(image, (0, 560), (1280, 250), (150, 154, 156), 3)
    return image


def to_pixel(east: float, north: float) -> tuple[float, float]:
    return WIDTH / 2 + east * 28.0, HEIGHT / 2 - north * 28.0


def box(system_id: int, track_id: int, east: float, north: float, heading_deg: float, confidence: float) -> Box:
    cx, cy = to_pixel(east, north)
    heading = math.radians(heading_deg)
    return Box(
        track_id=track_id,
        cx=cx,
        cy=cy,
        w=62.0,
        h=38.0,
        angle=heading - math.pi / 2,
        heading=heading,
        score=0.91,
        coasting=False,
        system_id=system_id,
        confidence=confidence,
        runner_up=15 if system_id else 0,
        runner_up_confidence=0.02 if system_id else NAN,
        residual_m=0.42 if system_id else NAN,
        residual_px=6.1 if system_id else NAN,
        position_age_s=0.2 if system_id else NAN,
        projection=0.92 if system_id else NAN,
        topology=0.88 if system_id else NAN,
        fused=0.97 if system_id else NAN,
        p_enu=np.array([east, north, 0.0]),
        lat_deg=47.397742,
        lon_deg=8.545594,
    )


def vehicle(
    system_id: int,
    east: float,
    north: float,
    heading: float,
    standing: Standing,
    confidence: float,
    state: str,
    age: float,
) -> VehicleRow:
    return VehicleRow(
        system_id=system_id,
        name=f"UGV-{system_id}",
        role="ugv",
        kind="rover",
        mode="AUTO",
        armed=True,
        fix="RTK" if state == "ok" else "3D",
        heartbeat_age_s=age if state == "lost" else 0.4,
        position_age_s=age,
        position_state=state,
        loss=0.01 * (system_id % 4),
        p_enu=np.array([east, north, 0.0]),
        heading=math.radians(heading),
        std_m=1.2 if state == "ok" else 4.0,
        in_view=None if math.isnan(east) else standing != "out of view",
        standing=standing,
        track_id=system_id - 8 if not math.isnan(confidence) else 0,
        confidence=confidence,
    )


def make_snapshot(frame: int = 1234, *, live: bool = False, t_us: int | None = None) -> Snapshot:
    """Seven ground vehicles: sure, doubtful, coasting, unnamed, out of view, lost; one box that is nobody's."""
    image = texture().copy()
    rows = [vehicle(*entry) for entry in FLEET]
    boxes = [
        box(row.system_id, row.track_id, *entry[1:4], row.confidence)
        for row, entry in zip(rows, FLEET, strict=True)
        if row.track_id
    ]
    boxes = [replace(each, coasting=each.system_id == 14) for each in boxes]
    boxes += [box(0, 21, 16.0, 5.0, 220.0, 0.4), box(0, 0, -17.0, -9.0, NAN, 0.8)]
    boxes[-1] = replace(boxes[-1], angle=0.3)
    for each in boxes:
        corners = cv2.boxPoints(((each.cx, each.cy), (each.w - 8, each.h - 8), math.degrees(each.angle)))
        cv2.fillPoly(image, [np.round(corners).astype(np.int32)], (214, 218, 222))
    uav = replace(
        vehicle(1, -2.0, -4.0, 12.0, "out of view", NAN, "ok", 0.1),
        name="UAV-1",
        role="uav",
        kind="copter",
        mode="GUIDED",
        in_view=None,
        standing="out of view",
        fix="RTK float",
        p_enu=np.array([-2.0, -4.0, 40.0]),
    )
    health = Health(
        fps=24.9, lag_s=0.12, frames=frame, skipped_frames=3, video="ok",
        recording_since_us=START_US,
        free_bytes=52_400_000_000, links=(
            LinkHealth(name="udpin:0.0.0.0:14550", packets=48_211, bad=4, dropped=0, silent_s=0.0),
            LinkHealth(name="/dev/ttyUSB0", packets=911, bad=0, dropped=2, silent_s=6.2 if live else 0.1),
        ),
    )  # fmt: skip
    return Snapshot(
        t_us=START_US + 251_400_000 if t_us is None else t_us,
        frame=frame,
        width=WIDTH,
        height=HEIGHT,
        image=image,
        vehicles=(uav, *rows),
        boxes=tuple(boxes),
        uav_enu=uav.p_enu,
        uav_heading=uav.heading,
        health=health,
        footprint_enu=np.array([[-22.9, 12.9], [22.9, 12.9], [22.9, -12.9], [-22.9, -12.9]]),
    )


def make_events() -> tuple[Event, ...]:
    said = [
        (2.0, "info", "recording", "session 2026-11-20_10-33-12Z opened", 0),
        (3.1, "info", "vehicle", "UAV-1 heard: copter, GUIDED", 1),
        (4.0, "info", "vehicle", "UGV-11 heard: rover, AUTO", 11),
        (20.5, "info", "identity", "UGV-12 confirmed on track 4 (99%)", 12),
        (61.0, "warning", "link", "link /dev/ttyUSB0 silent for 3.5 s", 0),
        (95.2, "info", "identity", "UGV-11 confirmed on track 3 (97%)", 11),
        (130.0, "alarm", "vehicle", "UGV-17 position lost", 17),
        (180.4, "warning", "identity", "UGV-13 tentative: UGV-15 is as likely", 13),
        (240.0, "info", "text", "UGV-11 says: EKF3 IMU0 is using GPS", 11),
    ]
    return tuple(
        Event(t_us=START_US + round(at * 1e6), level=level, kind=kind, text=text, system_id=who)  # type: ignore[arg-type]
        for at, level, kind, text, who in said
    )


class FakeTimeline:
    """A replay's clock that moves only when told."""

    def __init__(self) -> None:
        self.start_us, self.stop_us = START_US, STOP_US
        self.now_us = START_US + 251_400_000
        self.analysed: list[tuple[int, int]] = [(START_US, STOP_US)]
        self.gaps: list[Gap] = []
        self.sure: dict[int, NDArray[np.float32]] = {}
        self.past = Trails()
        self.playing = False
        self.speed = 1.0
        self.steps: list[int] = []

    def confidence(self, system_id: int) -> NDArray[np.float32]:
        return self.sure.get(system_id, np.full(10, np.nan, dtype=np.float32))

    def play(self) -> None:
        self.playing = True

    def pause(self) -> None:
        self.playing = False

    def seek(self, t_us: int) -> None:
        self.now_us = min(max(t_us, self.start_us), self.stop_us)

    def step(self, frames: int) -> None:
        self.playing = False
        self.steps.append(frames)

    def trails(self, t_us, span_s, origin):
        return self.past.before(t_us, span_s, origin)

    def set_speed(self, speed: float) -> None:
        self.speed = speed


class FakeStation:
    """What a screen is given in tests; change its fields to make something happen."""

    def __init__(self, *, live: bool = False, snapshot: Snapshot | None = None) -> None:
        self.title = "live" if live else "2026-11-20_10-33-12Z"
        self.timeline = None if live else FakeTimeline()
        self.error: BaseException | None = None
        self.snapshot: Snapshot | None = make_snapshot(live=live) if snapshot is None else snapshot
        self.said: list[Event] = list(make_events())
        self.seen: list[Alarm] = []
        self.accepted: list[int] = []
        self.taken = 0
        self.heard, self.changes, self.practice = (), [], None
        self.stated: list[tuple[int, int | None]] = []
        self.stopped = 0
        self.other_view: FakeStation | None = None
        self.folder: Path | None = None
        self.tiles: Path | None = None

    def latest(self) -> Snapshot | None:
        return self.snapshot

    def events(self) -> Sequence[Event]:
        return self.said

    def mark(self, t_us: int, text: str, system_id: int = 0) -> None:
        self.add_event(Event(t_us=t_us, level="info", kind="mark", text=text, system_id=system_id))

    def add_event(self, event: Event) -> None:
        self.said.append(event)

    def acknowledge(self, alarms: Sequence[Alarm]) -> None:
        self.seen += alarms

    def state_name(self, track_id: int, system_id: int) -> None:
        self.stated.append((track_id, system_id))

    def undo_statement(self, track_id: int = 0) -> None:
        self.stated.append((track_id, None))

    def rates(self):
        return ()

    def newcomers(self):
        return self.heard

    def change_fleet(self, change) -> None:
        if change.system_id == 99:
            raise ValueError("[b]99 cannot be left out")
        self.changes.append(change)

    def accept_held(self, system_ids: Sequence[int]) -> None:
        self.accepted += system_ids

    def save_mission(self) -> str:
        return "the mission is saved in mission.toml"

    def take_rival_video(self) -> None:
        self.taken += 1

    def next_view(self) -> FakeStation | None:
        return self.other_view

    def pictures(self) -> list[CameraPicture]:
        views = [self, *([self.other_view] if self.other_view else [])]
        return [CameraPicture(name=each.title, snapshot=each.latest(), on_show=each is self) for each in views]

    def stop(self) -> None:
        self.stopped += 1


def hostile_station(text: str) -> FakeStation:
    """Every string that may come from the air is ``text``."""
    station = FakeStation(live=True)
    base = make_snapshot(live=True)
    rows = tuple(
        replace(
            row, name=text, kind=text, mode=text, fix=text, position_state=text, refusals={text: 3}, bad_signature=1
        )
        for row in base.vehicles
    )
    health = replace(
        base.health,
        video=text,
        keys=0,
        write_reason=text,
        undecoded=2,
        links=tuple(replace(link, name=text) for link in base.health.links),
    )
    alarms = tuple(
        Alarm(key=text, level=level, kind=text, text=text, advice=text, since_us=START_US, system_id=11)
        for level in ("alarm", "warning", "info")
    )
    station.title = text
    station.said = [
        Event(t_us=START_US, level=level, kind=kind, text=text, system_id=11)
        for level in ("info", "warning", "alarm")
        for kind in ("text", text)
    ]
    station.snapshot = replace(base, vehicles=rows, health=health, events=tuple(station.said), alarms=alarms)
    return station


SMALL, WIDE = (80, 24), (160, 48)


@asynccontextmanager
async def running(station=None, size=SMALL):
    station = FakeStation() if station is None else station
    app = RollcallApp(station, graphics="blocks")
    async with app.run_test(size=size) as pilot:
        for pane in app._panes.panes:
            pane.rest_s = 0.0  # a test does not wait for a picture
        await pilot.pause()
        yield app, pilot, station


async def comes_true(pilot, condition):
    """Whether something comes to hold of the screens within a minute."""
    for _ in range(3000):
        if condition():
            return True
        await pilot.pause(0.02)
    return False


async def polled(app, pilot):
    app._poll()
    await pilot.pause()


def text_of(widget) -> str:
    return "\n".join(widget.render_line(y).text for y in range(widget.size.height))


def screen_text(app) -> str:
    return "\n".join("".join(segment.text for segment in row) for row in app.screen._compositor.render_strips())


def on_screen(app) -> set[str]:
    deck = app.query_one(PaneArea)
    return {pane.id for pane in app.query(Pane) if pane.display and deck.has_room(pane.id)}
