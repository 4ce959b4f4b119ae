"""How each order is carried out: asked once, another way when the first is not known, or again and again in a stream.

A stream follows a ground vehicle by the positions heard here. It waits while they are missing, ends after a while
without them, and ends at the first refusal or when somebody else changes the flight mode: it never takes the UAV back
from a pilot.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Protocol

from gcs.command import wire
from gcs.command.answer import Answer
from gcs.command.paths import Path, above, circles, points
from gcs.command.uav import Uav
from gcs.command.wire import Command, Place
from gcs.snapshot import Level

__all__ = ["Asker", "Jobs", "Rules"]


class Asker(Protocol):
    """Whoever brings a command to the UAV."""

    async def ask(self, command: Command) -> Answer:
        """Its answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rules:
    """How often, how far, how long."""

    point_s: float = 0.5
    """Between two places for the camera: shorter → follows closer, more on the link."""
    fly_s: float = 1.0
    """Between two goals for the UAV."""
    lost_s: float = 10.0
    """Without a position for so long a stream ends."""
    radius_m: float = 20.0
    """Of a circle around a vehicle."""
    speed_mps: float = 3.0
    """Along that circle."""
    moved_m: float = 5.0
    """A vehicle that has gone so far is circled around anew."""
    settle_s: float = 2.0
    """For the flight mode to be the one that an order asked for."""
    text_s: float = 0.3
    """After a refusal, for the reason to come as text."""


Tell = Callable[[Level, str], None]


class Jobs:
    """Carries orders out; every method returns when its order has ended."""

    def __init__(
        self,
        asker: Asker,
        uav: Uav,
        where: Callable[[int], Place | None],
        *,
        own: tuple[int, int],
        rules: Rules,
    ) -> None:
        self._asker, self._uav, self._where = asker, uav, where
        self._own, self._rules = own, rules
        self._photos = 0
        self._by_key: dict[str, Callable[[int, Tell], Awaitable[object]]] = {
            "point": self._point,
            "track": self._track,
            "above": self._above,
            "follow": self._follow,
            "orbit": self._orbit,
            "hold": self._hold,
            "return": lambda ugv, tell: self._once(wire.return_to_launch(), tell),
            "unpoint": lambda ugv, tell: self._once(wire.point_nowhere(), tell),
            "neutral": self._neutral,
            "take": lambda ugv, tell: self._control(True, tell),
            "release": lambda ugv, tell: self._control(False, tell),
            "photo": self._photo,
            "record": lambda ugv, tell: self._once(wire.record_start(self._uav.camera_component), tell),
            "record_stop": lambda ugv, tell: self._once(wire.record_stop(self._uav.camera_component), tell),
        }

    async def carry_out(self, key: str, ugv: int, tell: Tell) -> None:
        """Carries an order out.

        Args:
            key: of the order.
            ugv: system id that it is about, 0 for none.
            tell: given a level and what became of it.
        """
        await self._by_key[key](ugv, tell)

    async def _ask(self, command: Command) -> Answer:
        """An answer with what the autopilot said meanwhile."""
        since_s = time.monotonic()
        self._uav.take_progress(command.number)
        answer = await self._asker.ask(command)
        if not answer.accepted:
            await asyncio.sleep(self._rules.text_s)
        progress = self._uav.take_progress(command.number)
        return replace(answer, progress=progress, texts=self._uav.texts_since(since_s))

    async def _once(self, command: Command, tell: Tell) -> Answer:
        answer = await self._ask(command)
        tell("info" if answer.accepted else "warning", answer.words)
        return answer

    async def _first_known(self, commands: tuple[Command, ...], tell: Tell) -> None:
        for command in commands[:-1]:
            answer = await self._ask(command)
            if not answer.not_known:
                tell("info" if answer.accepted else "warning", answer.words)
                return
        await self._once(commands[-1], tell)

    async def _point(self, ugv: int, tell: Tell) -> None:
        answer = await self._ask(wire.point_at_system(ugv))
        if answer.accepted:
            tell("info", "accepted; it follows the positions that it hears itself")
        elif answer.not_known:
            tell("info", f"{answer.words}; by the positions heard here instead")
            await self._track(ugv, tell)
        else:
            tell("warning", answer.words)

    async def _track(self, ugv: int, tell: Tell) -> None:
        def look(place: Place, first: bool) -> Command | None:
            ground_m = self._uav.ground_m
            return None if math.isnan(ground_m) else wire.point_at_place(place, ground_m)

        await self._stream(ugv, look, self._rules.point_s, tell, flies=False)

    async def _above(self, ugv: int, tell: Tell) -> None:
        place, alt_m = self._where(ugv), self._uav.alt_m
        if place is None or math.isnan(alt_m):
            tell("warning", "not sent: where it is is not known" if place is None else _NO_HEIGHT)
            return
        await self._once(wire.reposition(place, alt_m, change_mode=True), tell)

    async def _follow(self, ugv: int, tell: Tell) -> None:
        alt_m = self._uav.alt_m
        if math.isnan(alt_m):
            tell("warning", _NO_HEIGHT)
            return
        await self._stream(ugv, above(alt_m), self._rules.fly_s, tell)

    async def _orbit(self, ugv: int, tell: Tell) -> None:
        place, alt_m, rules = self._where(ugv), self._uav.alt_m, self._rules
        if place is None or math.isnan(alt_m):
            tell("warning", "not sent: where it is is not known" if place is None else _NO_HEIGHT)
            return
        answer = await self._ask(wire.orbit(place, alt_m, rules.radius_m, rules.speed_mps))
        if answer.accepted:
            tell("info", answer.words)
            path = circles(
                place, alt_m, radius_m=rules.radius_m, speed_mps=rules.speed_mps, moved_m=rules.moved_m
            )  # fmt: skip
            await self._stream(ugv, path, rules.fly_s, tell, begun=True)
        elif answer.not_known:
            tell("info", f"{answer.words}; point by point instead")
            path = points(alt_m, radius_m=rules.radius_m, speed_mps=rules.speed_mps, period_s=rules.fly_s)
            await self._stream(ugv, path, rules.fly_s, tell)
        else:
            tell("warning", answer.words)

    async def _hold(self, ugv: int, tell: Tell) -> None:
        command = wire.hold(self._uav.kind, self._uav.autopilot)
        if command is None:
            tell("warning", "not sent: no mode to hold a position is known for this autopilot")
        else:
            await self._once(command, tell)

    async def _neutral(self, ugv: int, tell: Tell) -> None:
        await self._first_known((wire.gimbal_neutral(self._uav.gimbal_component), wire.mount_neutral()), tell)

    async def _control(self, take: bool, tell: Tell) -> None:
        command = wire.gimbal_control(*self._own, take=take, component=self._uav.gimbal_component)
        await self._once(command, tell)

    async def _photo(self, ugv: int, tell: Tell) -> None:
        self._photos += 1
        await self._once(wire.photo(self._photos, self._uav.camera_component), tell)

    async def _stream(
        self, ugv: int, path: Path, period_s: float, tell: Tell, *, flies: bool = True, begun: bool = False
    ) -> None:
        """Commands by the newest place until a refusal, a pilot, a long silence, or the next order."""
        first, missing_s, flown_s, mode = not begun, 0.0, 0.0, ""
        while True:
            place = self._where(ugv)
            if place is None:
                if missing_s == 0.0:
                    tell("warning", "waits: where it is is not known")
                missing_s += period_s
                if missing_s > self._rules.lost_s:
                    tell("alarm", f"ended: no position for {self._rules.lost_s:.0f} s")
                    return
            else:
                missing_s = 0.0
                command = path(place, first)
                answer = None if command is None else await self._ask(command)
                if answer is not None and not answer.accepted:
                    tell("warning", answer.words if first else f"ended: {answer.words}")
                    return
                if answer is not None and first:
                    tell("info", "accepted; goes on until another order")
                    first = False
            await asyncio.sleep(period_s)
            flown_s += period_s
            if flies and flown_s >= self._rules.settle_s:
                mode = mode or self._uav.mode
                if self._uav.mode != mode:
                    tell("warning", f"ended: the flight mode was changed to {self._uav.mode}")
                    return


_NO_HEIGHT = "not sent: its own height is not known"
