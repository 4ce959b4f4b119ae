"""Packets that are not believed, in masses."""

import time

from mavlink.ingest.plan import Signing
from mavlink.ingest.receiver import BURST_S, KEPT_PER_S, RefusedPacketLimiter
from mavlink.links.batch import Batch
from mavlink.links.fair_shares import HOLD_S
from mavlink.links.report import LinkCounts, LinkReport
from mavlink.protocol.encoder import MavlinkEncoder
from mavlink.protocol.packet import Auth
from mavlink.signing.keys import Key, write_key
from mavlink.signing.signer import Signer
from tests.support.receiving import HOST, read_to, recorded
from tests.support.waiting import until

FRAMES = {k: MavlinkEncoder(k).heartbeat() for k in (11, 12)}
REPORT = LinkReport(name="udp", counts=LinkCounts(turned_away=5))


def batch_of(*rows):
    """(system id, sender, auth) of each frame."""
    frames = [FRAMES[system_id] for system_id, _, _ in rows]
    return Batch([0] * len(rows), frames, [peer for _, peer, _ in rows]), [auth for _, _, auth in rows]


def test_only_refused_packets_are_left_out_and_only_those_of_who_sends_them_in_masses():
    now_s = 100.0
    limiter = RefusedPacketLimiter(lambda: now_s)
    rows = [(11, 1, Auth.BAD), (11, 1, Auth.GOOD), (12, 1, Auth.UNSIGNED), (11, 2, Auth.HELD)]
    kept = dict.fromkeys(rows, 0)
    for _ in range(600):
        now_s += 0.01
        batch, auths = limiter.limit(0, *batch_of(*[rows[0]] * 30, *rows[1:]))
        for raw, peer, auth in zip(batch.frames, batch.peers, auths, strict=True):
            kept[raw[5], peer, auth] += 1
    assert [kept[row] for row in rows[1:]] == [600] * 3
    assert kept[rows[0]] <= KEPT_PER_S * (BURST_S + 6.0) + 1 and kept[rows[0]] > KEPT_PER_S * 6.0
    told = limiter.add_to_report(0, REPORT, lambda peer: f"10.0.0.{peer}:5")
    assert told.counts.turned_away == 5 + 600 * 30 - kept[rows[0]]
    (limit,) = told.limits
    assert (limit.address, limit.system_id, limit.refused) == ("10.0.0.1:5", 11, True)
    assert limit.turned_away == 600 * 30 - kept[rows[0]]
    assert limiter.add_to_report(1, REPORT, str) == REPORT
    now_s += HOLD_S
    assert limiter.add_to_report(0, REPORT, str).limits == ()


def test_what_is_believed_costs_nothing():
    limiter = RefusedPacketLimiter()
    batch, auths = batch_of(*[(11, 1, Auth.GOOD), (12, 2, Auth.OPEN)] * 10_000)
    assert limiter.limit(0, batch, auths) == (batch, auths)


def test_a_crowd_is_watched_as_one_and_costs_no_memory():
    limiter = RefusedPacketLimiter(lambda: 100.0)
    for peer in range(5000):
        limiter.limit(0, *batch_of((11, peer, Auth.BAD)))
    assert len(limiter._senders) < 1100
    assert [limit.address for limit in limiter.add_to_report(0, REPORT, lambda peer: "").limits] == ["many addresses"]


def test_a_vehicle_is_recorded_through_a_flood_that_is_signed_wrongly_from_its_own_address(started, sender, tmp_path):
    keys, secret = tmp_path / "keys", bytes(range(1, 33))
    keys.mkdir(mode=0o700)
    write_key(keys, 11, secret)
    ingest, port = started(signing=Signing(keys=str(keys)), system_ids=(11,))
    good, forger, speaker = Signer(Key(secret)), Signer(Key(bytes(32 * [9]))), MavlinkEncoder(11)

    def say(signer):
        frame = signer.sign(speaker.heartbeat(), time.time_ns() // 1000)
        sender.sendto(frame, (HOST, port))
        return frame

    true, false, packets, texts = [], [], [], []
    words = f"{HOST}:{sender.getsockname()[1]} as system 11 floods this link with packets that are"

    def is_told():
        """Whether it is, after some more of the flood; no more is on the way than any system's buffer holds."""
        true.append(say(good))
        packets.extend(read_to(ingest, true[-1]))
        false.extend(say(forger) for _ in range(100))
        texts.extend(notice.text for notice in ingest.notices())
        return any(words in text for text in texts)

    assert until(is_told)
    true.append(say(good))
    packets += read_to(ingest, true[-1])
    assert {packet.raw for packet in packets if packet.auth is Auth.GOOD} == set(true)
    ingest.stop()
    log = recorded(tmp_path)
    assert set(true) <= set(log) and len(log) < len(true) + len(false)
    health = ingest.health()
    counts = health.links[0].counts
    assert health.refused + counts.turned_away + counts.dropped == len(false)
