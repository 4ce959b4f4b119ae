"""Ways to carry an order out: asked once, another way when the first is not known, or again and again in a stream.

That an autopilot accepts to point the camera proves little: ArduPilot accepts to follow a vehicle it does not receive,
and nothing moves. So pointing counts as done when the gimbal reports to look there; else the next way is tried.

A stream follows a ground vehicle by the positions received here. It waits while they are missing, ends after a while
without them, and ends at the first refusal or when another sender changes the flight mode: it never takes the UAV back
from a pilot.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from gcs.command import mav_cmd
from gcs.command.ack import CommandAck
from gcs.command.mav_cmd import Command, GeoPoint
from gcs.command.uav import Uav
from mavlink.geodesy import LocalFrame
from mavlink.state import Level

Path = Callable[[GeoPoint, bool], Command | None]
"""Function from the newest position, and whether this is the first command, to the command; None when there is nothing
to send."""
Verdict = Literal["not yet", "done", "not moved", "unknown"]
THERE_RAD = math.radians(15.0)
"""Angle to its goal below which the camera has it in view: most see 30° to either side, and gimbals lag behind."""
PROGRESS_RAD = math.radians(2.0)
"""Angle by which a gimbal that turns at all turns within the patience."""
Report = Callable[[Level, str], None]
_SEE_PERIOD_S = 0.1
"""Seconds between checks that the camera turns."""
_NO_HEIGHT = "not sent: its own height is not known"


@dataclass(slots=True)
class PointingMonitor:
    """Watches the angle between where the camera looks and where it should.

    Attributes:
        off_rad: the last angle known, NaN while none was.
    """

    patience_s: float
    """Time without progress after which a gimbal counts as standing still, s."""
    since_s: float
    """Time of the order, then of the last progress."""
    off_rad: float = math.nan
    _best_rad: float = math.inf

    def update(self, off_rad: float, now_s: float) -> Verdict:
        """Verdict by what is known now.

        Args:
            off_rad: between the optical axis and the goal, NaN unknown.
            now_s: monotonic seconds.
        """
        if math.isfinite(off_rad):
            self.off_rad = off_rad
            if off_rad <= THERE_RAD:
                return "done"
            if off_rad < self._best_rad - PROGRESS_RAD:
                self._best_rad, self.since_s = off_rad, now_s
        if now_s - self.since_s < self.patience_s:
            return "not yet"
        return "unknown" if math.isnan(self.off_rad) else "not moved"


def above(alt_m: float) -> Path:
    """Return the position over the vehicle at a height above sea level."""
    return lambda place, first: mav_cmd.reposition(place, alt_m, change_mode=first)


def circles(around: GeoPoint, alt_m: float, *, radius_m: float, speed_mps: float, moved_m: float) -> Path:
    """The orbit again whenever its middle has moved on; the first was ordered already."""
    middle = around

    def circle(place: GeoPoint, first: bool) -> Command | None:
        nonlocal middle
        if _distance_m(middle, place) < moved_m:
            return None
        middle = place
        return mav_cmd.orbit(place, alt_m, radius_m, speed_mps)

    return circle


def points(alt_m: float, *, radius_m: float, speed_mps: float, period_s: float) -> Path:
    """Points on a circle around the vehicle, clockwise, for autopilots without orbits."""
    angle = 0.0

    def point(place: GeoPoint, first: bool) -> Command | None:
        nonlocal angle
        # φ ← φ + v Δt / r
        angle += speed_mps * period_s / radius_m
        return mav_cmd.reposition(_beside(place, radius_m, angle), alt_m, change_mode=first)

    return point


def _beside(place: GeoPoint, distance_m: float, bearing: float) -> GeoPoint:
    """A place at a distance and a bearing from north."""
    frame = LocalFrame(place.lat_deg, place.lon_deg)
    lat, lon, _ = frame.to_geodetic([distance_m * math.sin(bearing), distance_m * math.cos(bearing), 0.0])
    return GeoPoint(float(lat), float(lon))


def _distance_m(a: GeoPoint, b: GeoPoint) -> float:
    east, north, _ = LocalFrame(a.lat_deg, a.lon_deg).to_enu_point(b.lat_deg, b.lon_deg, 0.0)
    return math.hypot(east, north)


class CommandSender(Protocol):
    """A way to bring a command to the UAV."""

    async def send(self, command: Command) -> CommandAck:
        """Send a command and return the vehicle's answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandParams:
    """Rates, distances and patience of an order."""

    point_s: float = 0.5
    """Seconds between two places for the camera: shorter → follows closer, more on the link."""
    fly_s: float = 1.0
    """Seconds between two goals for the UAV."""
    lost_s: float = 10.0
    """Time without a position after which a stream of commands ends, s."""
    radius_m: float = 20.0
    """Radius of a circle around a vehicle."""
    speed_mps: float = 3.0
    """Speed along the circle, m/s."""
    moved_m: float = 5.0
    """Way of a vehicle after which it is circled around again."""
    settle_s: float = 2.0
    """Time for the flight mode to become the one that an order asked for, s."""
    see_s: float = 5.0
    """Time for a gimbal to report that it turns where it was ordered to, s: its reports may have to be asked for
    first."""
    text_s: float = 0.3
    """Time after a refusal for the reason to come as text, s."""


class CommandExecutor:
    """Carries orders out; every method returns when its order has ended."""

    def __init__(
        self,
        sender: CommandSender,
        uav: Uav,
        where: Callable[[int], GeoPoint | None],
        *,
        own: tuple[int, int],
        params: CommandParams,
    ) -> None:
        self._sender, self._uav, self._where = sender, uav, where
        self._own, self._params = own, params
        self._photos = 0
        self._by_key: dict[str, Callable[[int, Report], Awaitable[object]]] = {
            "point": self._point,
            "track": self._track,
            "above": self._above,
            "follow": self._follow,
            "orbit": self._orbit,
            "hold": self._hold,
            "return": lambda ugv, report: self._once(mav_cmd.return_to_launch(), report),
            "unpoint": lambda ugv, report: self._once(mav_cmd.point_nowhere(), report),
            "neutral": self._neutral,
            "take": lambda ugv, report: self._control(True, report),
            "release": lambda ugv, report: self._control(False, report),
            "photo": self._photo,
            "record": lambda ugv, report: self._once(mav_cmd.record_start(self._uav.camera_component), report),
            "record_stop": lambda ugv, report: self._once(mav_cmd.record_stop(self._uav.camera_component), report),
        }

    async def carry_out(self, key: str, ugv: int, report: Report) -> None:
        """Carry an order out.

        Args:
            key: of the order.
            ugv: system id that it is about, 0 for none.
            report: given a level and what became of it.
        """
        await self._by_key[key](ugv, report)

    async def _ask(self, command: Command) -> CommandAck:
        """An answer, with the texts that the autopilot sent meanwhile."""
        since_s = time.monotonic()
        self._uav.take_progress(command.number)
        answer = await self._sender.send(command)
        if not answer.accepted:
            await asyncio.sleep(self._params.text_s)
        progress = self._uav.take_progress(command.number)
        return replace(answer, progress=progress, texts=self._uav.texts_since(since_s))

    async def _once(self, command: Command, report: Report) -> CommandAck:
        answer = await self._ask(command)
        report("info" if answer.accepted else "warning", answer.words)
        return answer

    async def _first_known(self, commands: tuple[Command, ...], report: Report) -> None:
        for command in commands[:-1]:
            answer = await self._ask(command)
            if not answer.not_known:
                report("info" if answer.accepted else "warning", answer.words)
                return
        await self._once(commands[-1], report)

    async def _point(self, ugv: int, report: Report) -> None:
        answer = await self._ask(mav_cmd.point_at_system(ugv))
        if not answer.accepted and not answer.not_known:
            report("warning", answer.words)
            return
        if answer.not_known:
            report("info", f"{answer.words}; by the positions received here instead")
        else:
            report("warning", f"{await self._left_alone(ugv, report)}; by the positions received here instead")
        await self._track(ugv, report)

    async def _left_alone(self, ugv: int, report: Report) -> str:
        """Watches an autopilot that is to follow a vehicle by itself; why that does not do."""
        monitor, done = self._pointing_monitor(), False
        while True:
            verdict = monitor.update(self._off_rad(ugv), time.monotonic())
            if verdict == "not moved" or (verdict == "unknown" and not done):
                return f"the camera does not follow: {_off(monitor)}" if done else f"accepted, but {_words(monitor)}"
            if verdict == "done" and not done:
                done = True
                report("info", "done: the camera looks there; the autopilot follows the positions it receives itself")
            if verdict != "not yet":
                monitor = self._pointing_monitor()
            await asyncio.sleep(_SEE_PERIOD_S)

    async def _track(self, ugv: int, report: Report) -> None:
        """Point by the positions received here: in one way after the other, until the camera is seen to turn."""
        uav = self._uav

        def place(place: GeoPoint, first: bool) -> Command | None:
            return None if math.isnan(uav.ground_m) else mav_cmd.point_at_place(place, uav.ground_m)

        def angles(place: GeoPoint, first: bool) -> Command | None:
            to = uav.angles_to(place)
            return None if to is None else mav_cmd.gimbal_angles(to[0], to[1], uav.gimbal_component)

        def older_angles(place: GeoPoint, first: bool) -> Command | None:
            to = uav.angles_to(place)
            return None if to is None else mav_cmd.mount_angles(to[0], to[2])

        ways = (("its place", place), ("angles", angles), ("angles the older way", older_angles))
        for k, (_, way) in enumerate(ways):
            last = k == len(ways) - 1
            instead = "" if last else f"; by {ways[k + 1][0]} instead"
            watch = self._camera_watch(ugv, report)
            if await self._stream(ugv, way, self._params.point_s, report, watch, instead=instead):
                return

    def _pointing_monitor(self) -> PointingMonitor:
        return PointingMonitor(self._params.see_s, time.monotonic())

    def _off_rad(self, ugv: int) -> float:
        """Angle between where the camera looks and a ground vehicle, NaN unknown."""
        place = self._where(ugv)
        return math.nan if place is None else self._uav.off_rad(place)

    async def _above(self, ugv: int, report: Report) -> None:
        place, alt_m = self._where(ugv), self._uav.alt_m
        if place is None or math.isnan(alt_m):
            report("warning", "not sent: where it is is not known" if place is None else _NO_HEIGHT)
            return
        await self._once(mav_cmd.reposition(place, alt_m, change_mode=True), report)

    async def _follow(self, ugv: int, report: Report) -> None:
        alt_m = self._uav.alt_m
        if math.isnan(alt_m):
            report("warning", _NO_HEIGHT)
            return
        await self._stream(ugv, above(alt_m), self._params.fly_s, report, self._mode_watch())

    async def _orbit(self, ugv: int, report: Report) -> None:
        place, alt_m, params = self._where(ugv), self._uav.alt_m, self._params
        if place is None or math.isnan(alt_m):
            report("warning", "not sent: where it is is not known" if place is None else _NO_HEIGHT)
            return
        answer = await self._ask(mav_cmd.orbit(place, alt_m, params.radius_m, params.speed_mps))
        if answer.accepted:
            report("info", answer.words)
            path = circles(place, alt_m, radius_m=params.radius_m, speed_mps=params.speed_mps, moved_m=params.moved_m)
            await self._stream(ugv, path, params.fly_s, report, self._mode_watch(), begun=True)
        elif answer.not_known:
            report("info", f"{answer.words}; point by point instead")
            path = points(alt_m, radius_m=params.radius_m, speed_mps=params.speed_mps, period_s=params.fly_s)
            await self._stream(ugv, path, params.fly_s, report, self._mode_watch())
        else:
            report("warning", answer.words)

    async def _hold(self, ugv: int, report: Report) -> None:
        command = mav_cmd.hold(self._uav.kind, self._uav.autopilot)
        if command is None:
            report("warning", "not sent: no mode to hold a position is known for this autopilot")
        else:
            await self._once(command, report)

    async def _neutral(self, ugv: int, report: Report) -> None:
        await self._first_known((mav_cmd.gimbal_neutral(self._uav.gimbal_component), mav_cmd.mount_neutral()), report)

    async def _control(self, take: bool, report: Report) -> None:
        command = mav_cmd.gimbal_control(*self._own, take=take, component=self._uav.gimbal_component)
        await self._once(command, report)

    async def _photo(self, ugv: int, report: Report) -> None:
        self._photos += 1
        await self._once(mav_cmd.photo(self._photos, self._uav.camera_component), report)

    async def _stream(
        self,
        ugv: int,
        path: Path,
        period_s: float,
        report: Report,
        watch: Callable[[], str],
        *,
        instead: str = "",
        begun: bool = False,
    ) -> bool:
        """Commands by the newest place until a refusal, a long silence, what is watched for, or the next order.

        Args:
            report: given what becomes of it.
            watch: asked after each command since the first was accepted; why to end, empty: go on.
            instead: what is done then, or where the command is not known; empty: nothing.
            begun: the first command was given already.

        Returns:
            Whether it is over; False: what is done instead comes next.
        """
        first, missing_s = not begun, 0.0
        while True:
            place = self._where(ugv)
            if place is None:
                if missing_s == 0.0:
                    report("warning", "waits: where it is is not known")
                missing_s += period_s
                if missing_s > self._params.lost_s:
                    report("alarm", f"ended: no position for {self._params.lost_s:.0f} s")
                    return True
            else:
                missing_s = 0.0
                command = path(place, first)
                answer = None if command is None else await self._ask(command)
                if answer is not None and not answer.accepted:
                    then = instead if first and answer.not_known else ""
                    report("warning", f"{answer.words}{then}" if first else f"ended: {answer.words}")
                    return not then
                if answer is not None and first:
                    report("info", "accepted; goes on until another order")
                    first = False
            await asyncio.sleep(period_s)
            if not first and (why := watch()):
                report("warning", f"{why}{instead}")
                return not instead

    def _mode_watch(self) -> Callable[[], str]:
        """End when another sender changes the flight mode."""
        since_s, mode = time.monotonic(), ""

        def watch() -> str:
            nonlocal mode
            if time.monotonic() - since_s < self._params.settle_s:
                return ""
            mode = mode or self._uav.mode
            return "" if self._uav.mode == mode else f"ended: the flight mode was changed to {self._uav.mode}"

        return watch

    def _camera_watch(self, ugv: int, report: Report) -> Callable[[], str]:
        """End when the camera is seen not to turn at all; report whether it follows, or that this is not known."""
        monitor: PointingMonitor | None = None
        reported: Verdict = "not yet"
        done = False

        def watch() -> str:
            nonlocal monitor, reported, done
            seen = monitor = monitor or self._pointing_monitor()
            verdict = seen.update(self._off_rad(ugv), time.monotonic())
            if verdict == "not moved" and not done:
                return f"accepted, but {_words(seen)}"
            if verdict != "not yet":
                monitor = None
                done |= verdict == "done"
                if verdict != reported:
                    reported = verdict
                    report(*_seen(verdict, seen))
            return ""

        return watch


def _words(monitor: PointingMonitor) -> str:
    """Words for what is seen of a camera that does not look where it should."""
    if math.isnan(monitor.off_rad):
        return "nothing reports where the camera looks"
    return f"the camera did not move: {_off(monitor)}"


def _off(monitor: PointingMonitor) -> str:
    return f"it looks {math.degrees(monitor.off_rad):.0f}° off"


def _seen(verdict: Verdict, monitor: PointingMonitor) -> tuple[Level, str]:
    """Words for what is reported of a camera while commands go on."""
    if verdict == "done":
        return "info", "done: the camera looks there"
    if verdict == "unknown":
        return "warning", f"accepted, but {_words(monitor)}"
    return "warning", f"the camera does not follow: {_off(monitor)}"
