"""Messages between a process and its child: msgspec Structs, written as MessagePack into two pipes.

Nothing that comes in is more than the numbers, texts and bytes of the types that are expected, so that a child that was
taken over can send false values and do nothing else.
"""

from __future__ import annotations

import select
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

import msgspec

from infra.program_log import log_as_parent

MAX_BYTES = 1 << 20

Received = TypeVar("Received")


class MessageChannel(Generic[Received]):
    """One end of a channel of messages. Any thread may send, one receives.

    Args:
        reading: where messages come from.
        writing: where they go to.
        received: the type of those that come, or the union of their types.
    """

    def __init__(
        self,
        reading: Connection[Any, Any],
        writing: Connection[Any, Any],
        received: type[Received] | Any,  # noqa: ANN401
        most_bytes: int = MAX_BYTES,
    ) -> None:
        self._reading, self._writing, self._most_bytes = reading, writing, most_bytes
        self._decoder: msgspec.msgpack.Decoder[Received] = msgspec.msgpack.Decoder(received)
        # two threads that close one pipe may close a descriptor that was reused meanwhile
        self._sending = threading.Lock()

    def fileno(self) -> int:
        """The file descriptor to wait for until a message comes."""
        return self._reading.fileno()

    def send(self, message: msgspec.Struct, timeout_s: float | None = None) -> None:
        """Send a message; without a timeout it waits for as long as the other end takes.

        Raises:
            OSError: the other end is gone, this one is closed, or it was not taken in time.
        """
        data = msgspec.msgpack.encode(message)
        with self._sending:
            if timeout_s is not None and not select.select([], [self._writing], [], timeout_s)[1]:
                raise TimeoutError("it reads no messages")
            self._writing.send_bytes(data)

    def receive(self, timeout_s: float | None = None) -> Received | None:
        """The next message; None where none comes in time.

        Raises:
            EOFError: the other end is gone, or sends something else.
        """
        try:
            if not self._reading.poll(timeout_s):
                return None
            return self._decoder.decode(self._reading.recv_bytes(self._most_bytes))
        except (OSError, msgspec.DecodeError) as error:
            raise EOFError from error

    def close_sending(self) -> None:
        """Show the other end that no more comes; twice does nothing."""
        with self._sending:
            self._writing.close()

    def close(self) -> None:
        """Close both ways; to be called by who receives."""
        self.close_sending()
        self._reading.close()


def connect_to_parent(
    requests: type[Received] | Any,  # noqa: ANN401 - unions are no types
    most_bytes: int = MAX_BYTES,
) -> MessageChannel[Received]:
    """A child's end, in a program that :class:`infra.processes.child_process.ChildProcess` started.

    From here on it logs into its parent's files.
    """
    log_as_parent()
    reading, writing = map(int, sys.argv[1:3])
    ends = Connection(reading, writable=False), Connection(writing, readable=False)
    return MessageChannel(*ends, requests, most_bytes)
