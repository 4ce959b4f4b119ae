"""Choice of the sender that is listened to where several send to one port: what decodes, and of that who was first.

1. What no picture comes out of has no right to the port.
2. A sender that has shown one keeps its place before those who came later, and has it back with its next key frame
   after a pause; its host keeps that right at another port. The operator's choice comes before all.
3. Another one that decodes is listened to once the present one has been silent for 1.5 s, or has sent nothing that
   decodes for 3 s. While both send they contest the port, which is reported.

A sender is an address, and in RTP its SSRC too. Times are those of arrival, so that a reader that was held up by
something else takes no one's place away.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence

from vision.stream.messages import Sender
from vision.stream.rtp import source_of
from vision.stream.source import Codec
from vision.stream.trial import Trial, looks_like

TAKEOVER_S = 1.5
"""Silence of the present sender after which another one may take its place: a radio's hole is usually shorter."""
BLIND_S = 3.0
"""Time without a picture from the present sender, s; a lost key frame is usually followed by the next within that."""
QUIET_S = 0.3
"""Silence of the present sender after which others are held, so that none of theirs is missing when they begin."""
RIVAL_S = 2.0
"""Silence after which a rival is none any more."""
PATIENCE_S = 6.0
"""Wait for a first picture before it is reported that none can be decoded."""
MAX_TRIALS = 4
MAX_PROVEN = 8
SHARE = 9.0
"""Factor on the time that a trial took for which the next one waits beside a sender that is shown: they must not cost
its frames."""


class Senders:
    """The senders of one port.

    Args:
        codec: what the source was said to be, empty: to be found out.
        proven: who has shown a picture before, the first with the best right.
        clock: seconds, for how long trials take.

    Attributes:
        present: who is listened to, None for nobody.
        proven: who has shown a picture, the first with the best right.
        refused: datagrams that were dropped.
    """

    def __init__(
        self, codec: Codec, proven: Sequence[Sender] = (), clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock = clock
        self.present: Sender | None = None
        self.proven = list(proven)
        self.refused = 0
        self._codec = codec
        self._trials: dict[Sender, Trial] = {}
        self._heard_s = self._shown_s = 0.0
        self._rivals: dict[Sender, float] = {}
        self._now_s = 0.0
        self._unknown: tuple[Sender, float] | None = None
        self._next_try_s = 0.0

    def hear(self, data: bytes, address: tuple[str, int], arrival_s: float) -> bool:
        """Take in a datagram; True when it is the present sender's, to be read."""
        self._now_s = max(self._now_s, arrival_s)
        kind = looks_like(data, self._codec)
        sender = Sender(host=address[0], port=address[1], stream=0 if kind == "mpegts" else source_of(data))
        if sender == self.present:
            self._heard_s = max(self._heard_s, arrival_s)
            return True
        if self.present is not None and (kind is None or not self._may_come(sender, arrival_s)):
            self.refused += 1
            return False
        if self._unknown is None:
            self._unknown = sender, arrival_s
        trial = (
            None
            if kind is None
            else self._trials.get(sender) or self._admit(sender, Trial(kind, self._codec, arrival_s))
        )
        if trial is not None:
            trial.add(data, arrival_s)
        else:
            self.refused += 1
        return False

    @property
    def strangers(self) -> int:
        """Datagrams of others than the camera, which may be who begins to send in its silence."""
        return self.refused + sum(trial.count for trial in self._trials.values() if self._is_beside(trial))

    def shown(self) -> None:
        """Note that the present sender has shown a picture."""
        self._shown_s = self._heard_s

    def successor(self) -> Sender | None:
        """Return the sender that is to be listened to from now on, None while it stays as it is."""
        self._try()
        ready = [sender for sender, trial in self._trials.items() if trial.proven]
        for sender in ready:
            self._note_proven(sender)
        best = min(ready, key=self._rank, default=None)
        if best is None or self.present is None or self._rank(best) < self._rank(self.present) or self._gives_way(best):
            return best
        for sender in ready:
            if self._is_beside(self._trials[sender]):
                self._rivals[sender] = self._trials[sender].heard_s
                self._drop(sender)
        return None

    def begin(self, sender: Sender) -> Trial:
        """Listen to a successor from now on; returns what is held of it."""
        before, self.present = self.present, sender
        if before is not None:
            self._rivals[before] = self._heard_s
        trial = self._trials.pop(sender)
        self._rivals.pop(sender, None)
        self._unknown = None
        self._heard_s = self._shown_s = trial.heard_s
        return trial

    def end(self) -> None:
        """Note that the present sender's connection is over; its right stays."""
        self.present, self._unknown = None, None

    def prefer(self, sender: Sender) -> None:
        """Give a sender the best right."""
        self.proven = [sender, *(other for other in self.proven if other != sender)][:MAX_PROVEN]

    @property
    def rival(self) -> Sender | None:
        """Another sender of what can be decoded, None if there is none."""
        self._rivals = {sender: heard for sender, heard in self._rivals.items() if self._now_s - heard < RIVAL_S}
        others = [sender for sender in self._rivals if sender != self.present]
        return min(others, key=self._rank, default=None) if self.present is not None else None

    @property
    def waited_in_vain(self) -> bool:
        """True if somebody has sent for a while, and nobody has shown a picture."""
        return self._unknown is not None and self._now_s - self._unknown[1] > PATIENCE_S

    def undecodable(self) -> tuple[Sender, bool] | None:
        """Return a sender of which nothing decodes, and whether it is RTP with video; None without one. From then on
        the wait starts again."""
        if self._unknown is None:
            return None
        (sender, _), self._unknown = self._unknown, None
        seems = [sender for sender, trial in self._trials.items() if trial.kind == "rtp" and trial.codec]
        return (seems[0], True) if seems else (sender, False)

    def _gives_way(self, other: Sender) -> bool:
        """Tell whether the present sender is silent, or shows nothing any more."""
        assert self.present is not None
        # an encoder that starts again has another SSRC and no pause
        anew = (other.host, other.port) == (self.present.host, self.present.port)
        silent_s = QUIET_S if anew else TAKEOVER_S
        return self._now_s - self._heard_s > silent_s or self._heard_s - self._shown_s > BLIND_S

    def _rank(self, sender: Sender) -> tuple[int, int]:
        """Return the rank of a sender by its host's first picture, then by its own: a camera that was switched off and
        on has another port."""
        hosts = [other.host for other in self.proven]
        last = len(self.proven)
        return (
            hosts.index(sender.host) if sender.host in hosts else last,
            self.proven.index(sender) if sender in self.proven else last,
        )

    def _may_come(self, sender: Sender, arrival_s: float) -> bool:
        """Tell whether to hold what a sender sends beside the present one; a rival is only noted."""
        assert self.present is not None
        known = sender in self.proven and sender not in self._trials
        if not known or self._rank(sender) < self._rank(self.present):
            return True
        self._rivals[sender] = arrival_s
        return arrival_s - self._heard_s > QUIET_S or self._heard_s - self._shown_s > QUIET_S

    def _note_proven(self, sender: Sender) -> None:
        if sender in self.proven:
            return
        if len(self.proven) >= MAX_PROVEN:
            self.proven.remove([other for other in self.proven if other != self.present][-1])
        self.proven.append(sender)

    def _admit(self, sender: Sender, trial: Trial) -> Trial | None:
        """Begin a trial if there is room: one host takes no other's, and what shows nothing gives way in time."""
        now_s = trial.began_s
        for silent in [s for s, t in self._trials.items() if now_s - t.heard_s >= RIVAL_S]:
            self._drop(silent)
        if len(self._trials) >= MAX_TRIALS:
            hosts = Counter(other.host for other in self._trials)
            victims = [s for s, t in self._trials.items() if not t.proven and s not in self.proven]
            if sender not in self.proven:
                crowded = [s for s in victims if hosts[s.host] > 1 and not hosts[sender.host]]
                victims = crowded or [s for s in victims if now_s - self._trials[s].began_s > PATIENCE_S]
            if not victims:
                return None
            self._drop(victims[0])
        self._trials[sender] = trial
        return trial

    def _drop(self, sender: Sender) -> None:
        trial = self._trials.pop(sender)
        self.refused += trial.count if self._is_beside(trial) else 0

    def _is_beside(self, trial: Trial) -> bool:
        """Tell whether who is on trial sends while the one sends that is listened to."""
        return trial.began_s < self._heard_s

    def _try(self) -> None:
        """See what decodes, for a part of the time where somebody is listened to."""
        for trial in sorted(self._trials.values(), key=lambda trial: trial.looks):
            began_s = self._clock()
            if began_s < self._next_try_s:
                return
            trial.look()
            now_s = self._clock()
            self._next_try_s = now_s + (now_s - began_s) * (SHARE if self.present is not None else 1.0)
