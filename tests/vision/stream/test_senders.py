"""Several senders on one port: who is listened to, on a clock of the test's own."""

from __future__ import annotations

import random
import struct

import pytest

from tests.support.video_senders import FPS, GOP, coded, packed
from vision.stream.messages import Sender
from vision.stream.senders import BLIND_S, MAX_PROVEN, PATIENCE_S, TAKEOVER_S, Senders
from vision.stream.trial import Trial

CLIP = 400
CAMERA, MOVED, STRANGER = ("10.0.0.7", 5004), ("10.0.0.7", 5010), ("10.0.0.66", 4000)


def film(frames, address, *, begin_s=0.0, stop_s=1e9, hole=(0.0, 0.0), source=None):
    """(time, address, datagram) of a sender; RTP may get another SSRC."""
    for k, datagrams in enumerate(frames):
        t_s = begin_s + k / FPS
        if t_s >= stop_s or hole[0] <= t_s < hole[1]:
            continue
        for data in datagrams:
            yield t_s, address, data if source is None else data[:8] + struct.pack("!I", source) + data[12:]


def junk(address, *, hz=5.0, stop_s=30.0, kind="rtp", begin_s=0.0):
    """Datagrams that look like video and are none."""
    rng = random.Random(4)
    for k in range(int((stop_s - begin_s) * hz)):
        data = rng.randbytes(752)
        head = {
            "rtp": struct.pack("!BBHII", 0x80, 96, k, k * 90, 9) + b"\x67",
            "mpegts": b"\x47",
            "noise": b"\x00",
        }[kind]
        yield begin_s + k / hz, address, head + data[len(head) :]


class Play:
    """Senders on a port, and a reader that shows what decodes.

    Attributes:
        read: (time, address) of each datagram that was handed on.
        turns: (time, sender) of each connection.
        rivals: (time, present, rival).
    """

    def __init__(self, *films, codec="", shows=lambda address: True, senders=None):
        self.now_s = 0.0
        self.senders = senders or Senders(codec, clock=lambda: self.now_s)
        self.read, self.turns, self.rivals = [], [], []
        for t_s, address, data in sorted((row for film in films for row in film), key=lambda row: row[0]):
            self.now_s = t_s
            if self.senders.hear(data, address, t_s):
                self.read.append((t_s, address))
                if shows(address):
                    self.senders.shown()
            successor = self.senders.successor()
            if successor is not None:
                held = self.senders.begin(successor).held
                self.turns.append((t_s, successor))
                self.read += [(arrival_s, (successor.host, successor.port)) for _, arrival_s in held]
            if self.senders.rival is not None:
                self.rivals.append((t_s, self.senders.present, self.senders.rival))

    def frames_of(self, address):
        return len({t_s for t_s, by in self.read if by == address})


@pytest.mark.slow_but_first
@pytest.mark.parametrize("frames", [coded(CLIP), packed(CLIP)], ids=["mpegts", "rtp"])
@pytest.mark.parametrize("kind", ["rtp", "mpegts", "noise"])
@pytest.mark.parametrize("first", [True, False])
def test_what_never_decodes_takes_nothing_away(frames, kind, first):
    """Five datagrams a second through a hole of 3.5 s, or from before the camera is switched on."""
    begin_s = 2.0 if first else 0.0
    play = Play(
        film(frames, CAMERA, begin_s=begin_s, hole=(4.0, 7.5)), junk(STRANGER, kind=kind, begin_s=0.0 if first else 3.0)
    )
    # a port whose reader gives up in the hole begins the same sender anew: here nobody does
    assert [sender.host for _, sender in play.turns] == [CAMERA[0]]
    assert play.frames_of(CAMERA) == len({row[0] for row in film(frames, CAMERA, begin_s=begin_s, hole=(4.0, 7.5))})
    assert play.frames_of(STRANGER) == 0 and play.senders.strangers > 0
    assert play.rivals == []


@pytest.mark.parametrize("frames", [coded(CLIP), packed(CLIP)], ids=["mpegts", "rtp"])
def test_a_camera_that_moves_is_taken_over_with_every_frame(frames):
    moved = list(film(frames, MOVED, begin_s=4.0))
    play = Play(film(frames, CAMERA, stop_s=4.0), moved, junk(STRANGER))
    assert [sender.port for _, sender in play.turns] == [CAMERA[1], MOVED[1]]
    assert TAKEOVER_S - 1 / FPS < play.turns[1][0] - 4.0 < 3.0
    assert play.frames_of(MOVED) == CLIP


@pytest.mark.parametrize("later", [CAMERA, MOVED])
def test_a_camera_that_goes_on_after_a_pause_is_no_stranger(later):
    """Its connection is over; it comes with the rest of a group of frames, and is silent again."""
    play = Play(film(coded(CLIP), CAMERA, stop_s=4.0))
    play.senders.end()
    rest = film(coded(GOP), later, begin_s=6.0, hole=(6.0, 6.0 + 0.5 / FPS))
    cut = Play(rest, senders=play.senders)
    assert cut.turns == [] and cut.senders.strangers == 0
    back = Play(film(coded(CLIP), later, begin_s=12.0), senders=play.senders)
    assert len(back.turns) == 1 and back.senders.strangers == 0


def test_an_encoder_that_begins_anew_at_the_same_address_has_no_pause():
    play = Play(film(packed(CLIP), CAMERA, stop_s=4.0), film(packed(CLIP), CAMERA, begin_s=4.0, source=77))
    assert [sender.stream == 77 for _, sender in play.turns] == [False, True]
    assert play.turns[1][0] < 4.0 + TAKEOVER_S / 2
    assert play.frames_of(CAMERA) == 4 * FPS + CLIP


def test_two_films_are_a_contest_that_the_first_wins():
    play = Play(film(packed(CLIP), CAMERA), film(packed(CLIP), STRANGER, begin_s=2.0, stop_s=CLIP / FPS, source=66))
    assert play.frames_of(CAMERA) == CLIP and play.frames_of(STRANGER) == 0
    t_s, present, rival = play.rivals[0]
    assert t_s < 2.5 and (present.host, rival.host) == (CAMERA[0], STRANGER[0])
    assert len({t_s for t_s, _, _ in play.rivals}) > 0.9 * (CLIP - 2.5 * FPS)


def test_who_was_first_has_its_place_back_with_the_next_key_frame():
    play = Play(film(coded(CLIP), CAMERA, hole=(4.0, 8.0)), film(coded(CLIP), STRANGER, begin_s=2.0, stop_s=15.0))
    assert [sender.host for _, sender in play.turns] == [CAMERA[0], STRANGER[0], CAMERA[0]]
    assert 8.0 <= play.turns[2][0] <= 8.0 + 1.5 * GOP / FPS
    assert play.rivals[-1][2].host == STRANGER[0]


def test_the_host_of_the_first_keeps_its_right_at_another_port():
    play = Play(
        film(coded(CLIP), CAMERA, stop_s=4.0),
        film(coded(CLIP), STRANGER, begin_s=2.0),
        film(coded(CLIP), MOVED, begin_s=9.0),
    )
    assert [(sender.host, sender.port) for _, sender in play.turns] == [CAMERA, STRANGER, MOVED]
    assert play.turns[2][0] <= 9.0 + 1.5 * GOP / FPS


def test_the_operators_choice_comes_before_the_first():
    senders = Senders("", clock=lambda: 0.0)
    rows = sorted([*film(coded(CLIP), CAMERA), *film(coded(CLIP), STRANGER, begin_s=2.0)], key=lambda row: row[0])
    first = Play([row for row in rows if row[0] <= 5.0], senders=senders)
    assert [sender.host for _, sender in first.turns] == [CAMERA[0]]
    senders.prefer(senders.rival)
    then = Play([row for row in rows if row[0] > 5.0], senders=senders)
    assert [sender.host for _, sender in then.turns] == [STRANGER[0]]
    assert then.turns[0][0] < 5.0 + 1.5 * GOP / FPS and then.rivals[-1][2].host == CAMERA[0]


def test_a_sender_that_shows_nothing_any_more_gives_way():
    """It was the first, and sends junk from then on."""
    senders = Senders("", clock=lambda: 0.0)
    Play(film(coded(CLIP), STRANGER, stop_s=3.0), senders=senders)
    later = [
        junk(STRANGER, hz=25.0, kind="mpegts", begin_s=3.0, stop_s=7.0),
        film(coded(CLIP), CAMERA, begin_s=4.0, stop_s=7.0),
    ]
    play = Play(*later, senders=senders, shows=lambda address: address == CAMERA)
    assert [sender.host for _, sender in play.turns] == [CAMERA[0]]
    assert 3.0 + BLIND_S <= play.turns[0][0] <= 3.5 + BLIND_S


@pytest.mark.slow_but_first
@pytest.mark.parametrize("hosts", [1, 40])
def test_many_senders_of_junk_keep_no_camera_out(hosts):
    noise = [junk((f"10.0.1.{k % hosts}", 4000 + k), kind="mpegts", begin_s=0.1 * k) for k in range(40)]
    play = Play(film(packed(CLIP), CAMERA, begin_s=6.0), *noise)
    assert [sender.host for _, sender in play.turns] == [CAMERA[0]]
    assert play.turns[0][0] < 6.0 + (1.0 if hosts == 1 else PATIENCE_S)


def test_those_who_have_shown_a_picture_are_bounded_and_the_first_stay():
    films = [film(coded(60), (f"10.0.2.{k}", 5000), begin_s=3.0 * k) for k in range(MAX_PROVEN + 4)]
    play = Play(film(coded(1000), CAMERA), *films)
    assert [sender.host for _, sender in play.turns] == [CAMERA[0]]
    assert len(play.senders.proven) == MAX_PROVEN and play.senders.proven[0].host == CAMERA[0]


def test_a_process_that_was_replaced_knows_who_was_first():
    camera = Sender(host=CAMERA[0], port=CAMERA[1])
    play = Play(
        film(coded(CLIP), STRANGER),
        film(coded(CLIP), CAMERA, begin_s=1.0),
        senders=Senders("", [camera], clock=lambda: 0.0),
    )
    assert [sender.host for _, sender in play.turns] == [STRANGER[0], CAMERA[0]]


@pytest.mark.slow_but_first
@pytest.mark.parametrize(
    ("films", "rtp"),
    [
        ([film([frame for k, frame in enumerate(packed(CLIP)) if k % GOP], CAMERA)], True),
        ([junk(CAMERA, kind="noise")], False),
        ([junk(CAMERA, kind="mpegts")], False),
    ],
    ids=["no key frame", "noise", "mpegts"],
)
def test_who_sends_in_vain_is_told_once_in_a_while(films, rtp):
    play = Play(*films, codec="h264" if rtp else "")
    assert play.turns == [] and play.senders.waited_in_vain
    sender, seems = play.senders.undecodable()
    assert ((sender.host, sender.port), seems) == (CAMERA, rtp)
    assert not play.senders.waited_in_vain and play.senders.undecodable() is None


def test_what_is_held_of_a_sender_is_bounded(monkeypatch):
    monkeypatch.setattr("vision.stream.trial.HELD_BYTES", 500_000)
    data = struct.pack("!BBHII", 0x80, 96, 0, 0, 9) + b"\x67" + bytes(60_000)
    trial = Trial("rtp", "h264", 0.0)
    for k in range(40):
        trial.add(data[:2] + struct.pack("!HI", k, k * 90) + data[8:], k / 25)
        trial.look()
    assert sum(len(held) for held, _ in trial.held) <= 500_000 and not trial.proven
