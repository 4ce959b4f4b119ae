"""Topics of a PX4 log by pyulog, in a process of its own: formats of some hundred bytes may ask for all memory."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from infra.files.safe_open import open_to_read
from infra.processes.bounded import answer_parent, ask_child

__all__ = ["UlogTopics", "read_topics"]

_MORE_BYTES, _TIMES_LARGER = 200_000_000, 3
"""Of memory that a log may take: this and so many times its size."""
_LEAST_S, _BYTES_A_SECOND = 60.0, 1_000_000
"""For which it may take to be read."""


class _UlogColumn(msgspec.Struct):
    name: str
    type: str
    data: bytes


class _UlogTopic(msgspec.Struct):
    name: str
    columns: list[_UlogColumn]


class _UlogQuestion(msgspec.Struct):
    path: str
    topics: list[str]
    columns: list[str]


class UlogTopics(msgspec.Struct, tag=True):
    """What was found."""

    topics: list[_UlogTopic]
    """Those with rows, instances of one name by their numbers."""
    system_id: int
    """0 unknown."""
    damaged: bool

    def tables(self) -> dict[str, list[dict[str, NDArray[np.generic]]]]:
        """Columns by name of each instance of each topic."""
        found: dict[str, list[dict[str, NDArray[np.generic]]]] = {}
        for topic in self.topics:
            columns = {each.name: np.frombuffer(each.data, np.dtype(each.type)) for each in topic.columns}
            found.setdefault(topic.name, []).append(columns)
        return found


def read_topics(path: str, size: int, topics: list[str], columns: list[str]) -> UlogTopics:
    """Read a log.

    Args:
        path: of the file.
        size: bytes of it.
        topics: those that are wanted.
        columns: those that are wanted of them.

    Raises:
        UnreadError: it cannot be read, or asks for more than a log may.
    """
    return ask_child(
        __name__,
        _UlogQuestion(path, topics, columns),
        UlogTopics,
        most_bytes=_MORE_BYTES + _TIMES_LARGER * size,
        most_s=_LEAST_S + size / _BYTES_A_SECOND,
    )


def _read(question: _UlogQuestion) -> UlogTopics:
    from pyulog import ULog

    with open(open_to_read(question.path), "rb") as file:  # noqa: PTH123 - of a descriptor
        log = ULog(file, question.topics)
    topics = [
        _UlogTopic(each.name, _columns(each.data, question.columns))
        for each in sorted(log.data_list, key=lambda data: int(data.multi_id))
        if len(each.data.get("timestamp", ()))
    ]
    system_id = log.initial_parameters.get("MAV_SYS_ID", 0)
    known = isinstance(system_id, int) and 1 <= system_id <= 255
    return UlogTopics(topics, system_id if known else 0, bool(log.file_corruption))


def _columns(data: dict[str, NDArray[np.generic]], wanted: list[str]) -> list[_UlogColumn]:
    return [_UlogColumn(name, data[name].dtype.str, data[name].tobytes()) for name in wanted if name in data]


if __name__ == "__main__":
    answer_parent(_UlogQuestion, _read)
