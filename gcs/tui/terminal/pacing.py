"""A bound of what is on its way to a terminal, so that what is written next is seen soon. Pure; times are given.

Behind a terminal lies a queue that nobody can look into: the kernel's, SSH's, the network's. So every chunk ends with
a question (DSR, "are you well"), and its reply says that the terminal has shown the chunk. The quickest reply has the
line's own delay, the most bytes shown a second its rate, and the window, the bytes that may be unanswered, is what the
line carries meanwhile and ``QUEUE_S`` of queue, as BBR has it (Cardwell et al., ACM Queue 14(5), 2016).
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

QUESTION = b"\x1b[5n"
"""Device status report; terminals reply ``ESC [ 0 n`` at once, in order with what they show."""
QUEUE_S = 0.06
"""Time that may stand in queues: a part of the 0.3 s within which a key shows, which the line's own delay adds to."""
MIN_BYTES = 2_048
"""The window's lower limit: some rows of text, 0.03 s at 60 kB/s."""
FIRST_BYTES = 8_192
"""The window before anything is known of the line."""
MAX_BYTES = 1 << 20
"""The window's upper limit: more than any screen of half blocks has."""
CHUNKS = 8
"""A window goes in this many chunks: the line is never idle while the reply to one is on its way."""
MIN_CHUNK_BYTES = 512
"""Size below which the question itself, and moves of the cursor, would cost too much."""
RATES_KEPT = 8
"""The line's rate is the most of this many: a pause of the terminal is no slow line, and a slow line is found soon."""
MAX_CHUNKS = 64
"""Questions that are remembered of a terminal that never replies."""
LOST_S = 5.0
"""A reply that takes longer is taken for lost: the terminal may have been exchanged for another meanwhile."""


class _SentChunk(NamedTuple):
    size: int
    sent_s: float
    shown_before: int
    """Bytes that were shown when it was sent."""
    full: bool
    """True if the window was in use, so that the time it takes shows what the line can do."""


class Pacing:
    """The window of one terminal, and the chunks in it.

    A terminal that has never replied is paced by the writing alone: the window stays as it is at first, and a chunk is
    in it until the system has taken it.
    """

    def __init__(self) -> None:
        self.window = FIRST_BYTES
        self._shown = 0
        self._shortest_s = math.inf
        self._rates: deque[float] = deque(maxlen=RATES_KEPT)
        self._replies = False
        self._unanswered: deque[_SentChunk] = deque(maxlen=MAX_CHUNKS)
        self._unwritten: deque[_SentChunk] = deque()

    @property
    def on_its_way(self) -> int:
        """Bytes that the terminal has not shown yet, as far as is known."""
        return sum(chunk.size for chunk in (self._unanswered if self._replies else self._unwritten))

    @property
    def open_questions(self) -> int:
        """Replies that are to come, from a terminal that replies."""
        return len(self._unanswered) if self._replies else 0

    @property
    def _chunk(self) -> int:
        return max(self.window // CHUNKS, MIN_CHUNK_BYTES)

    def room(self, now_s: float) -> int:
        """Bytes that may be sent now as one chunk, 0 for none yet."""
        if self._replies and self._unanswered and now_s - self._unanswered[0].sent_s > LOST_S:
            self._unanswered.clear()
        return self._chunk if self.on_its_way + self._chunk <= self.window else 0

    def send(self, size: int, now_s: float) -> None:
        """Note that a chunk of ``size`` bytes goes out, with its question."""
        chunk = _SentChunk(size, now_s, self._shown, self.on_its_way + size > self.window - self._chunk)
        self._unanswered.append(chunk)
        self._unwritten.append(chunk)

    def written(self) -> None:
        """Note that the system has taken the eldest chunk that it had not yet."""
        self._unwritten.popleft()

    def replied(self, now_s: float) -> None:
        """Note that the terminal has answered the eldest question."""
        self._replies = True
        if self._unanswered:
            self._adapt(self._unanswered.popleft(), now_s)

    def _adapt(self, chunk: _SentChunk, now_s: float) -> None:
        delay_s = max(now_s - chunk.sent_s, 1e-6)
        self._shown += chunk.size
        self._shortest_s = min(self._shortest_s, delay_s)
        if chunk.full or delay_s - self._shortest_s > 2 * QUEUE_S:
            # rate = bytes shown since it was sent / the time that took
            self._rates.append((self._shown - chunk.shown_before) / delay_s)
        if self._rates:
            # window = rate · (shortest delay + queue); an unsaturated line is found by growing
            fit = max(self._rates) * (self._shortest_s + QUEUE_S)
            self.window = int(min(max(fit, MIN_BYTES), 2 * self.window, MAX_BYTES))
