"""The command service: orders in, frames to the UAV out, what became of them as events.

Orders are carried out in a thread with an event loop of its own, so that no screen and no fold ever waits. What the
station sends of its own accord - heartbeat, clock questions, rate requests - is driven by whoever calls
:meth:`CommandService.poll`.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from gcs.command.executor import CommandExecutor, CommandParams
from gcs.command.mav_cmd import GeoPoint
from gcs.command.mavsdk_client import MavsdkClient
from gcs.command.orders import Order, order_of, orders_about
from gcs.command.uav import Uav
from gcs.snapshot import Event
from infra.wall_clock import now_us
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.state import Level
from mavlink.transmit.heartbeat import HeartbeatTimer, TimeSyncTimer
from mavlink.transmit.message_rates import UAV_RATES, MessageRates
from mavlink.transmit.rate_requests import GIMBAL_ATTITUDE
from mavlink.transmit.transmitter import COMPONENT_ID, SYSTEM_ID, Transmitter

_STOP_S = 5.0
LOOK_S = 1.0


class CommandService:
    """Commands the UAV, and no other vehicle.

    Args:
        uav: system id of the UAV.
        ground: system ids of the ground vehicles, by name.
        transmitter: the way out, which lets nothing pass that is not for the UAV.
        where: the place of a ground vehicle by its system id, None when it is not known for sure and now.
        on_event: called with events, in the thread of the service or in the one that polls.
        own: system and component id that the station sends as.
        rates: message id → Hz wanted of the UAV.
        gimbal: that carries the camera: a device id 1-6 or a component id, 0: the first that reports.

    Attributes:
        rates: how often messages come, and what is asked of the UAV.
    """

    def __init__(
        self,
        *,
        uav: int,
        ground: Mapping[int, str],
        uav_name: str,
        transmitter: Transmitter,
        where: Callable[[int], GeoPoint | None],
        on_event: Callable[[Event], None],
        own: tuple[int, int] = (SYSTEM_ID, COMPONENT_ID),
        params: CommandParams | None = None,
        rates: Mapping[int, float] = UAV_RATES,
        gimbal: int = 0,
    ) -> None:
        self._uav_id, self._uav_name, self._ground = uav, uav_name, dict(ground)
        self._transmitter, self._on_event = transmitter, on_event
        encoder = MavlinkEncoder(*own)
        self._heartbeat, self._timesync = HeartbeatTimer(encoder), TimeSyncTimer(encoder)
        self.rates = MessageRates(encoder, uav, tuple(ground), own=own[0], uav_rates=rates)
        self._look_s = 0.0
        self._own = own
        self._holder: tuple[int, int] | None = None
        self._uav = Uav(gimbal)
        self._mavsdk = MavsdkClient(uav, own, transmitter.send)
        self._executor = CommandExecutor(self._mavsdk, self._uav, where, own=own, params=params or CommandParams())
        self._running: dict[str, tuple[Order, asyncio.Task[None]]] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)
        self._thread.start()

    def receive(self, packet: Packet) -> None:
        """Handle a received packet of any sender; rejected ones are left out."""
        self._transmitter.note_packet(packet)
        if packet.auth > Auth.GOOD:
            return
        self.rates.add_packet(packet, time.monotonic())
        if packet.system_id != self._uav_id:
            return
        self._uav.receive(packet)
        self._mavsdk.receive(packet)

    def poll(self) -> None:
        """Send what is due; called a few times a second by the loop that the heartbeat shows to be alive."""
        now_s = time.monotonic()
        for raw in (self._heartbeat.poll(now_s), self._timesync.poll(now_s, time.time_ns())):
            if raw is not None:
                self._transmitter.broadcast(raw)
        for link, raw in self.rates.poll(now_s):
            self._transmitter.send(raw, link)
        if now_s >= self._look_s:
            self._look_s = now_s + LOOK_S
            self._report_changes(now_s)

    def _report_changes(self, now_s: float) -> None:
        """Report rates that are too low, and who controls the gimbal."""
        for rate in self.rates.troubles(now_s):
            self._note("warning", "link", rate.words, rate.system_id)
        holder = self._uav.gimbal_holder
        if holder is not None and holder != self._holder:
            self._holder = holder
            who = "this station" if holder == self._own else f"system {holder[0]} component {holder[1]}"
            text = f"the gimbal of {self._uav_name} is controlled by {who if any(holder) else 'no station'}"
            self._note("info", "camera", text, self._uav_id)

    def set_ground(self, ground: Mapping[int, str]) -> None:
        """Take orders about these ground vehicles from now on: system ids by name."""
        self._ground = dict(ground)
        self.rates.set_ground(self._ground)

    def orders(self, system_id: int) -> Sequence[tuple[str, str]]:
        """Orders that may be given about a selected vehicle: keys and words."""
        about = system_id in self._ground
        return [(order.key, self._words_of(order, system_id)) for order in orders_about(ugv=about)]

    def submit(self, key: str, system_id: int) -> None:
        """Carry an order out; returns at once, what becomes of it comes as events.

        Args:
            key: of the order.
            system_id: the selected vehicle; 0 for none.

        Raises:
            KeyError: no such order.
            ValueError: it needs a ground vehicle, or the flight has ended.
        """
        order = order_of(key)
        if order.about == "ugv" and system_id not in self._ground:
            raise ValueError(f"{key}: needs one of the mission's ground vehicles")
        if not self._thread.is_alive():
            raise ValueError("the flight has ended")
        self._loop.call_soon_threadsafe(self._begin, order, system_id)

    def close(self) -> None:
        """End what runs and take MAVSDK down; closing twice does nothing."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(_STOP_S)

    def _words_of(self, order: Order, system_id: int) -> str:
        return order.words_with(self._uav_name, self._ground.get(system_id, "the vehicle"))

    def _begin(self, order: Order, system_id: int) -> None:
        if order.job and (before := self._running.pop(order.job, None)) is not None and not before[1].done():
            before[1].cancel()
        task = self._loop.create_task(self._carry_out(order, system_id))
        self._running[order.job or order.key] = (order, task)

    async def _carry_out(self, order: Order, system_id: int) -> None:
        words = self._words_of(order, system_id)

        def report(level: Level, text: str) -> None:
            about = system_id if order.about == "ugv" else self._uav_id
            self._note(level, "operator", f"{words}: {text}", about)

        report("info", "ordered")
        if order.job == "camera":
            self.rates.add_wanted(GIMBAL_ATTITUDE, UAV_RATES[GIMBAL_ATTITUDE])
        try:
            await self._executor.carry_out(order.key, system_id, report)
        except asyncio.CancelledError:
            report("info", "ended by another order")
            raise
        except Exception as error:  # noqa: BLE001 - one order fails, the station flies on
            report("alarm", f"failed: {error}")

    def _note(self, level: Level, kind: str, text: str, system_id: int) -> None:
        self._on_event(Event(t_us=now_us(), level=level, kind=kind, text=text, system_id=system_id))

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
            for _, task in self._running.values():
                task.cancel()
            self._loop.run_until_complete(asyncio.gather(*asyncio.all_tasks(self._loop), return_exceptions=True))
            # a command under way is waited for: MAVSDK must not be taken down beneath it
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
        finally:
            self._mavsdk.close()
            self._loop.close()
