"""What the station says by itself: heartbeat, clock questions, rate requests."""

from __future__ import annotations

import itertools

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.estimation.clock_health import TimeSyncExchanges
from mavlink.protocol.decode import decode
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth, Packet
from mavlink.transmit.heartbeat import HeartbeatTimer, TimeSyncTimer
from mavlink.transmit.message_rates import TRIES, UAV_RATES, MessageRates, uav_rates
from tests.support.frames import UAV, UGV, message, packet_of

BEAT = (2, 3, 0, 0, 4, 3)


# heartbeat


def test_one_heartbeat_a_second_and_none_while_nobody_asks():
    beat = HeartbeatTimer(MavlinkEncoder(254, 190))
    given = [beat.poll(i * 0.1) for i in range(30)]
    assert sum(raw is not None for raw in given) == 3
    assert beat.poll(500.0) is not None
    assert beat.poll(500.1) is None, "what was missed is not made up for"
    said = message(next(raw for raw in given if raw))
    assert (said.get_srcSystem(), said.get_srcComponent()) == (254, 190)
    assert (said.type, said.autopilot, said.base_mode & 128) == (6, 8, 0)


# clock


def test_the_clock_is_asked_for_every_few_seconds_with_our_own():
    sync = TimeSyncTimer(MavlinkEncoder(254, 190))
    asked = [(i * 0.1, sync.poll(i * 0.1, 10**18 + i)) for i in range(300)]
    times = [at for at, raw in asked if raw is not None]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 5.0 and times[-1] >= 20.0
    said = message(asked[0][1])
    assert (said.tc1, said.ts1, said.get_srcSystem()) == (0, 10**18, 254)


def test_the_fold_understands_the_answer():
    sync, exchanges = TimeSyncTimer(MavlinkEncoder(254, 190)), TimeSyncExchanges()
    sent_ns = message(sync.poll(0.0, 1_700_000_000_000_000_000)).ts1
    answer = Packet(sent_ns // 1000 + 4000, UAV.timesync(10**10, sent_ns))
    assert exchanges.add(decode(answer))
    assert exchanges.round_trip_s == pytest.approx(0.004)


# rates


class Sky:
    """A UAV that sends what it is told to, as far as it can, in simulated time."""

    def __init__(
        self, keeper: MessageRates, *, can: dict[int, float] | None = None, result: int = 0, streams=True
    ) -> None:
        self.keeper, self.result, self.streams = keeper, result, streams
        self.can = {30: 50.0, 33: 50.0, 285: 50.0, 24: 5.0, 2: 5.0, 132: 5.0, 136: 5.0} | (can or {})
        self.hz: dict[int, float] = {}
        self.due: dict[int, float] = {}
        self.now_s = 100.0
        self.boot_s = 0.0
        self.asked: list[tuple[float, object]] = []
        self.answers = True

    def frame(self, message_id: int) -> bytes:
        boot_ms = round((self.now_s - self.boot_s) * 1e3)
        if message_id == 30:
            return UAV.attitude(boot_ms, 0.0, 0.0, 0.0)
        if message_id == 33:
            return UAV.global_position_int(boot_ms, 47.0, 8.0, 500.0)
        if message_id == 2:
            return UAV.system_time(boot_ms, 1)
        if message_id == 24:
            return UAV.gps_raw_int(1, 47.0, 8.0, 500.0)
        if message_id == 132:
            return UAV.pack(dialect.MAVLink_distance_sensor_message(boot_ms, 20, 7000, 4000, 0, 0, 25, 255))
        if message_id == 136:
            return UAV.pack(dialect.MAVLink_terrain_report_message(0, 0, 100, 500.0, 40.0, 0, 24))
        return UAV.pack(
            dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, boot_ms, 0, [1, 0, 0, 0], 0, 0, 0, 0)
        )

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += 0.01
            if round(self.now_s * 100) % 100 == 0:
                self.keeper.add_packet(packet_of(UAV.heartbeat(2)), self.now_s)
            for message_id, hz in self.hz.items():
                while hz and self.now_s >= self.due.setdefault(message_id, self.now_s):
                    self.keeper.add_packet(packet_of(self.frame(message_id)), self.now_s)
                    self.due[message_id] += 1.0 / hz
            for link, raw in self.keeper.poll(self.now_s):
                assert link == 0
                self.hear(message(raw))

    def hear(self, said) -> None:
        self.asked.append((self.now_s, said))
        assert said.target_system == 1
        if not self.answers:
            return
        if said.get_type() == "REQUEST_DATA_STREAM":
            for message_id, stream in {30: 10, 33: 6, 24: 2, 2: 12, 285: 12, 132: 12, 136: 12}.items():
                if stream == said.req_stream_id and self.streams:
                    self.hz[message_id] = min(said.req_message_rate, self.can[message_id])
            return
        assert said.command == 511
        if self.result == 0:
            self.hz[int(said.param1)] = min(1e6 / said.param2, self.can[int(said.param1)])
        self.keeper.add_packet(
            packet_of(UAV.pack(dialect.MAVLink_command_ack_message(511, self.result, 0, 0, 254, 190))), self.now_s
        )


def keeper(**changes) -> MessageRates:
    return MessageRates(MavlinkEncoder(254, 190), 1, (7,), **changes)


def states(sky: Sky) -> dict[str, str]:
    return {rate.message: rate.state for rate in sky.keeper.rates(sky.now_s) if rate.system_id == 1}


def test_rates_are_asked_for_once_each_and_measured():
    sky = Sky(keeper())
    sky.run(2.5)
    assert sky.asked == [], "what comes by itself is measured first"
    assert set(states(sky).values()) == {"measuring"}
    sky.run(20.0)
    assert {int(said.param1): 1e6 / said.param2 for _, said in sky.asked} == pytest.approx(dict(UAV_RATES), rel=1e-4)
    assert len(sky.asked) == len(UAV_RATES)
    assert set(states(sky).values()) == {"ok"}
    for rate in sky.keeper.rates(sky.now_s):
        assert rate.measured_hz == pytest.approx(rate.wanted_hz, rel=0.1)


def test_what_comes_by_itself_is_not_asked_for():
    sky = Sky(keeper())
    sky.hz = {message_id: hz for message_id, hz in UAV_RATES.items() if message_id != 24}
    sky.run(20.0)
    assert [int(said.param1) for _, said in sky.asked] == [24]


@pytest.mark.parametrize("result", [2, 3, 4])
def test_refused_intervals_are_asked_for_as_streams(result):
    sky = Sky(keeper(), result=result)
    sky.run(40.0)
    kinds = [said.get_type() for _, said in sky.asked]
    assert kinds.count("COMMAND_LONG") == len(UAV_RATES)
    assert {said.req_stream_id for _, said in sky.asked if said.get_type() == "REQUEST_DATA_STREAM"} == {2, 6, 10, 12}
    assert states(sky) == dict.fromkeys(states(sky), "ok")


def test_what_is_never_reached_is_asked_for_five_times_and_told():
    sky = Sky(keeper(), can={30: 50.0, 33: 2.0, 285: 50.0, 24: 5.0, 2: 5.0})
    sky.run(90.0)
    assert sum(int(said.param1) == 33 for _, said in sky.asked) == TRIES
    rate = next(rate for rate in sky.keeper.rates(sky.now_s) if rate.message == "GLOBAL_POSITION_INT")
    assert (
        rate.state == "not reached" and rate.measured_hz == pytest.approx(2.0, rel=0.2) and "asked 5 times" in rate.hint
    )
    count = len(sky.asked)
    sky.run(60.0)
    assert len(sky.asked) == count


def test_a_refusal_of_both_ways_is_told():
    sky = Sky(keeper(), result=3, streams=False)
    sky.run(120.0)
    assert set(states(sky).values()) == {"refused"}
    assert len(sky.asked) <= TRIES * len(UAV_RATES)


def test_silence_costs_five_tries_one_at_a_time():
    sky = Sky(keeper())
    sky.answers = False
    sky.run(200.0)
    assert len(sky.asked) == TRIES * len(UAV_RATES)
    times = [at for at, _ in sky.asked]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 0.99


def test_after_a_reboot_everything_is_asked_again():
    sky = Sky(keeper())
    sky.run(20.0)
    sky.asked.clear()
    sky.hz = {33: 1.0}
    sky.boot_s = sky.now_s
    sky.run(20.0)
    assert {int(said.param1) for _, said in sky.asked} == set(UAV_RATES)
    assert set(states(sky).values()) == {"ok"}


def test_late_copies_are_no_reboot():
    sky = Sky(keeper(), can={30: 50.0, 33: 2.0, 285: 50.0, 24: 5.0, 2: 5.0})
    sky.boot_s = -1000.0
    for _ in range(60):
        sky.run(1.5)
        late_ms = round((sky.now_s - sky.boot_s - 10.0) * 1e3)
        sky.keeper.add_packet(packet_of(UAV.attitude(late_ms, 0.0, 0.0, 0.0)), sky.now_s)
    assert sum(int(said.param1) == 33 for _, said in sky.asked) == TRIES


def test_answers_to_another_station_are_not_ours():
    sky = Sky(keeper())
    sky.answers = False
    sky.run(4.0)
    assert len(sky.asked) >= 1
    before = len(sky.asked)
    raw = UAV.pack(dialect.MAVLink_command_ack_message(511, 3, 0, 0, 255, 190))
    sky.keeper.add_packet(packet_of(raw), sky.now_s)
    sky.run(30.0)
    assert all(said.get_type() == "COMMAND_LONG" for _, said in sky.asked[before:])


def test_each_link_is_asked_and_ground_vehicles_never_are():
    made = keeper()
    for i in range(200):
        now_s = 100.0 + i * 0.1
        made.add_packet(packet_of(UAV.heartbeat(2), link=0), now_s)
        made.add_packet(packet_of(UAV.heartbeat(2), link=3), now_s)
        made.add_packet(packet_of(UGV.heartbeat(), link=1), now_s)
        made.add_packet(packet_of(UGV.global_position_int(i, 47.0, 8.0, 500.0), link=1), now_s) if i % 10 == 0 else None
        made.add_packet(packet_of(MavlinkEncoder(9).heartbeat(), link=1), now_s)
        for link, raw in made.poll(now_s):
            assert link in (0, 3)
            assert message(raw).target_system == 1
    ugv = [rate for rate in made.rates(120.0) if rate.system_id == 7]
    assert [(rate.message, rate.state) for rate in ugv] == [("GLOBAL_POSITION_INT", "too slow")]
    assert ugv[0].measured_hz == pytest.approx(1.0, rel=0.2) and ugv[0].wanted_hz == 5.0
    assert (
        "a ground vehicle is never asked" in ugv[0].hint
        and "SRx_POSITION, from 4.7 on MAVx_POSITION, = 5" in ugv[0].hint
    )
    assert {rate.system_id for rate in made.rates(120.0)} == {1, 7}
    assert made.troubles(115.0) == [], "it must last"
    assert "GLOBAL_POSITION_INT comes at 1.0 of 5 Hz: a ground vehicle is never asked" in next(
        rate.words for rate in made.troubles(120.0) if rate.system_id == 7
    )
    assert made.troubles(120.1) == [], "told once"


def test_a_link_that_is_lost_is_no_trouble_of_rates():
    made, told = MessageRates(None, 1, (7,)), []
    for i in range(400):
        now_s = 100.0 + i * 0.1
        if not 10.0 < now_s - 100.0 < 25.0:
            made.add_packet(packet_of(UGV.global_position_int(i, 47.0, 8.0, 500.0), link=1), now_s)
            made.add_packet(packet_of(UGV.global_position_int(i, 47.0, 8.0, 500.0), link=1), now_s + 0.05)
        told += made.troubles(now_s)
    assert told == []


def lossy(seconds, kept, rate_hz=5.0):
    """What is told of a ground vehicle of whose packets some are lost on the way, and the hint that it has then."""
    made, told, speaker = MessageRates(None, 1, (7,)), [], MavlinkEncoder(7)
    for i in range(int(seconds * 10)):
        now_s = 100.0 + i * 0.1
        frames = [speaker.attitude(i, 0.0, 0.0, 0.0)]
        frames += [speaker.global_position_int(i, 47.0, 8.0, 500.0)] if i % int(10 / rate_hz) == 0 else []
        for raw in frames:
            if kept(i):
                made.add_packet(packet_of(raw, link=1), now_s)
        told += made.troubles(now_s)
    return [rate.words for rate in told]


def test_a_rate_about_the_limit_is_told_once():
    def kept(i):
        return i % 10 < (5 if i // 100 % 2 else 8)

    assert len(lossy(300, kept)) == 1


def test_what_a_lossy_link_swallows_is_not_put_down_to_the_stream_rate():
    (told,) = lossy(60, lambda i: i % 10 < 5)
    assert "of its packets are lost on this link" in told
    assert "SRx" not in told
    (told,) = lossy(120, lambda i: i < 600 or (i >= 620 and i % 10 < 5))
    assert "of its packets are lost on this link" in told, "also when a good link becomes a bad one"
    (told,) = lossy(60, lambda i: True, rate_hz=2.0)
    assert "SRx_POSITION, from 4.7 on MAVx_POSITION, = 5" in told


def test_a_message_that_ceases_is_told_though_it_was_slow_before():
    made, told = MessageRates(None, 1), []
    for i in range(400):
        now_s = 100.0 + i * 0.1
        made.add_packet(packet_of(UAV.heartbeat(2)), now_s)
        if i < 200:
            made.add_packet(packet_of(UAV.attitude(i, 0.0, 0.0, 0.0)), now_s)
        told += [rate.words for rate in made.troubles(now_s) if rate.message == "ATTITUDE"]
    assert [text.partition(":")[0] for text in told] == ["ATTITUDE comes at 10.0 of 30 Hz", "ATTITUDE does not come"]


def test_a_silent_station_measures_and_asks_nothing():
    made = MessageRates(None, 1)
    for i in range(100):
        made.add_packet(packet_of(UAV.heartbeat(2)), i * 0.1)
        assert made.poll(i * 0.1) == []
    assert {rate.state for rate in made.rates(10.0)} == {"too slow"}
    hints = {rate.message: rate.hint for rate in made.rates(10.0)}
    assert all("--command" in hints[needed] for needed in ("ATTITUDE", "GLOBAL_POSITION_INT", "GPS_RAW_INT"))
    assert hints["GIMBAL_DEVICE_ATTITUDE_STATUS"] == hints["SYSTEM_TIME"] == "", "nobody knows that it has them"
    for i in range(100, 200):
        raw = dialect.MAVLink_system_time_message(1, i * 100) if i < 110 else dialect.MAVLink_heartbeat_message(*BEAT)
        made.add_packet(packet_of(UAV.pack(raw)), i * 0.1)
    assert "--command" in next(rate.hint for rate in made.rates(20.0) if rate.message == "SYSTEM_TIME")


def test_refused_packets_measure_nothing():
    made = keeper()
    made.add_packet(packet_of(UAV.heartbeat(2), auth=Auth.BAD), 0.0)
    assert made.rates(10.0) == () and made.poll(10.0) == []


def test_a_slower_radio_whose_packets_are_refused_says_nothing_of_rates():
    """A vehicle signs for two radios with one counter: while both bring it, little of the slower one counts."""
    made, told = MessageRates(None, 1, (7,)), []
    for i in range(600):
        now_s, raw = 100.0 + i * 0.1, UGV.global_position_int(i, 47.0, 8.0, 500.0)
        if i % 2 == 0:
            made.add_packet(packet_of(raw, link=0, auth=Auth.GOOD), now_s)
            made.add_packet(packet_of(raw, link=1, auth=Auth.GOOD if i % 20 == 0 else Auth.REPLAYED), now_s)
        told += made.troubles(now_s)
    assert told == []


def test_the_gimbal_is_wanted_where_it_is_followed():
    assert set(UAV_RATES) - set(uav_rates(gimbal=False)) == {285} and uav_rates(gimbal=True) == UAV_RATES
