"""A film of strangers read in a process of its own, with bounds of memory and time.

FFmpeg has many readers and decoders; a film that brings one down, or has it go on for ever, is one line for who asked.
"""

from __future__ import annotations

import os
import resource
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, TypeVar

import av
import msgspec
import numpy as np
import psutil
from numpy.typing import NDArray

from infra.plain_text import plain
from infra.processes.bounded import ONE_THREAD, bound
from infra.processes.channel import MessageChannel, connect_to_parent
from infra.processes.child_process import KILL_S, ChildProcess
from infra.shared_memory import make_memory, map_memory
from vision.errors import VideoError
from vision.video.frame_index import FrameIndex, FrameReader, read_index, read_tags, reason

_INDEX_BYTES, _TIMES_LARGER = 1 << 30, 3
"""Memory that an index may take: this much for the first picture, and this many times the file's size."""
_PICTURES_BYTES, _PICTURES_SHARE = 4 << 30, 0.5
"""Memory that pictures may take, those that others are coded by included: this much, or that share of the machine's."""
_NEXT_S = 60.0
"""Longest time for the next picture in sequence, s."""
_SLOWEST_BYTES_A_SECOND = 250_000
"""Slowest pace through a whole film: its index, and a picture that others come before, may take this much longer."""
_WAKE_S = 1.0
"""Time between two looks at whether the process that is waited for could have answered, s."""
_ORPHAN_S = 5.0
"""Time between two looks of the process at whether who started it still lives, s."""
_MAX_MESSAGE = (1 << 31) - 1

Answer = TypeVar("Answer")


class _IndexMessage(msgspec.Struct, tag=True):
    """A frame index, with bytes for its lists, and the tags of the film's header."""

    width: int
    height: int
    pts: bytes
    key_pts: bytes
    tick_us: float
    quarter_turns: int
    aspect: float
    shown_as: str
    tags: dict[str, str]


class _OpenFilm(msgspec.Struct, tag=True):
    path: bytes
    """Path as the system has it: names need not be UTF-8."""
    memory: int
    """File descriptor of the memory for a picture."""
    index: _IndexMessage | None
    """None: it is to be read and told."""


class _BeginFrames(msgspec.Struct, tag=True):
    width: int
    height: int
    """Size that pictures are to have; there is memory for one."""


class _GoTo(msgspec.Struct, tag=True):
    start: int
    """The frame to begin with, which is answered."""


class _NextFrame(msgspec.Struct, tag=True):
    pass


class _ReadFrame(msgspec.Struct, tag=True):
    index: int


class _Begun(msgspec.Struct, tag=True):
    pass


class _Decoded(msgspec.Struct, tag=True):
    index: int
    """The image is in the memory."""


class _NoMore(msgspec.Struct, tag=True):
    pass


class _NotRead(msgspec.Struct, tag=True):
    why: str


_Request = _OpenFilm | _BeginFrames | _GoTo | _NextFrame | _ReadFrame
_Answer = _IndexMessage | _Begun | _Decoded | _NoMore | _NotRead


class FilmReader:
    """One decoder at one place in a film; ``read`` goes to any frame, ``frames`` is the last use.

    Args:
        path: the file.
        index: its own, where that is known; None: it is read.

    Attributes:
        index: its frames.
        tags: of its header, by their names in capitals; none where the index was given.

    Raises:
        VideoError: no such file, not a video, no frame in it; FFmpeg does not read it in bounds.
    """

    def __init__(self, path: Path, index: FrameIndex | None = None) -> None:
        self._path = path
        size = path.stat().st_size if path.is_file() else 0
        self._most_s = _NEXT_S + size / _SLOWEST_BYTES_A_SECOND
        try:
            self._memory = os.fdopen(make_memory(0), "r+b", buffering=0)
            self._process: ChildProcess[_Answer] = ChildProcess(
                __name__, _Answer, fds=[self._memory.fileno()], environment=ONE_THREAD, most_bytes=_MAX_MESSAGE
            )
        except OSError as error:
            raise VideoError(f"video {path}: no process starts to read it: {error.strerror}") from error
        self.close = weakref.finalize(self, _end, self._process, self._memory)
        self._image: NDArray[np.uint8] | None = None
        self._next = 0
        """The frame that its decoder comes to next; -1 where that is not known."""
        self._ended = ""
        """Reason why it answers no more, empty while it does."""
        self._ask(_OpenFilm(os.fsencode(path), self._memory.fileno(), None if index is None else _packed(index, {})))
        self.tags: dict[str, str] = {}
        if index is None:
            found = self._receive(_IndexMessage, self._most_s)
            assert found is not None
            index, self.tags = _unpacked(found), found.tags
        self.index = index

    def frames(self, start: int) -> Iterator[tuple[int, NDArray[np.uint8]]]:
        """Index and image of the frames from that one on.

        Raises:
            VideoError: FFmpeg does not come to the next one.
        """
        image = self._begun()
        self._ask(_GoTo(start))
        picture = self._receive(_Decoded, self._most_s)
        while picture is not None:
            shown = image.copy()
            self._ask(_NextFrame())  # it is decoded while this one is looked at
            yield picture.index, shown
            picture = self._receive(_Decoded, _NEXT_S)

    def read(self, index: int) -> NDArray[np.uint8] | None:
        """Decode a frame, None when it does not decode.

        Raises:
            VideoError: FFmpeg does not come to it.
        """
        image = self._begun()
        self._ask(_ReadFrame(index))
        most_s, self._next = _NEXT_S if index == self._next else self._most_s, -1
        if self._receive(_Decoded, most_s) is None:
            return None
        self._next = index + 1
        return image.copy()

    def _begun(self) -> NDArray[np.uint8]:
        """The memory for a picture, of the size that the index has now."""
        if self._image is None:
            width, height = self.index.width, self.index.height
            os.ftruncate(self._memory.fileno(), width * height * 3)
            self._ask(_BeginFrames(width, height))
            self._receive(_Begun, self._most_s)
            self._image = _image(self._memory.fileno(), width, height)
        return self._image

    def _ask(self, request: _Request) -> None:
        with suppress(OSError):  # it is gone, which who receives sees
            self._process.channel.send(request)

    def _receive(self, wanted: type[Answer], most_s: float) -> Answer | None:
        """The next answer, None at the end; a process that gave none in time, or ended, is asked no more."""
        if self._ended:
            raise VideoError(self._ended)
        began_s, before = time.monotonic(), self._process.processor_time
        while self._process.able_s(time.monotonic() - began_s, before) < most_s:
            try:
                answer = self._process.channel.receive(_WAKE_S)
            except EOFError:
                break
            if isinstance(answer, _NotRead):
                raise VideoError(plain(answer.why))
            if answer is not None:
                return answer if isinstance(answer, wanted) else None
        else:
            # what it still says would be taken for the answer to the next question
            self._process.kill()
            self._ended = f"video {self._path}: FFmpeg takes longer than {most_s:.0f} s for one answer"
            raise VideoError(self._ended)
        self._process.end(KILL_S)
        self._ended = f"video {self._path}: FFmpeg ended: {plain(self._process.exit_reason)}"
        raise VideoError(self._ended)


def _end(process: ChildProcess[_Answer], memory: IO[bytes]) -> None:
    process.kill()
    process.close()
    memory.close()


def _image(memory: int, width: int, height: int) -> NDArray[np.uint8]:
    return np.frombuffer(map_memory(memory), dtype=np.uint8).reshape(height, width, 3)


def _packed(index: FrameIndex, tags: dict[str, str]) -> _IndexMessage:
    return _IndexMessage(
        width=index.width,
        height=index.height,
        pts=np.array(index.pts, dtype=np.int64).tobytes(),
        key_pts=index.key_pts.tobytes(),
        tick_us=index.tick_us,
        quarter_turns=index.quarter_turns,
        aspect=index.aspect,
        shown_as=index.shown_as,
        tags=tags,
    )


def _unpacked(index: _IndexMessage) -> FrameIndex:
    pts = np.frombuffer(index.pts, dtype=np.int64).tolist()
    return FrameIndex(
        width=index.width,
        height=index.height,
        pts=pts,
        order={stamp: i for i, stamp in enumerate(pts)},
        key_pts=np.frombuffer(index.key_pts, dtype=np.int64),
        tick_us=index.tick_us,
        quarter_turns=index.quarter_turns,
        aspect=index.aspect,
        shown_as=index.shown_as,
    )


# ---- the process


class _FilmWorker:
    """The film that the process reads for its parent."""

    def __init__(self, parent: MessageChannel[_Request]) -> None:
        self._parent = parent
        self.path, self._memory = Path(), -1
        self._index: FrameIndex
        self._reader: FrameReader
        self._image: NDArray[np.uint8]
        self._frames: Iterator[tuple[int, NDArray[np.uint8]]] = iter(())

    def answer(self, request: _Request) -> None:
        """Answer one request."""
        if isinstance(request, _OpenFilm):
            self.path, self._memory = Path(os.fsdecode(request.path)), request.memory
            self._open(request.index)
        elif isinstance(request, _BeginFrames):
            _bound_memory(min(_PICTURES_BYTES, int(_PICTURES_SHARE * psutil.virtual_memory().total)))
            self._image = _image(self._memory, request.width, request.height)
            self._reader = FrameReader(self.path, replace(self._index, width=request.width, height=request.height))
            self._parent.send(_Begun())
        elif isinstance(request, _GoTo):
            self._reader.go(request.start)
            self._frames = self._reader.frames()
            self._show(next(self._frames, None))
        elif isinstance(request, _NextFrame):
            self._show(next(self._frames, None))
        else:
            image = self._reader.read(request.index)
            self._show(None if image is None else (request.index, image))

    def _open(self, given: _IndexMessage | None) -> None:
        if given is not None:
            self._index = _unpacked(given)
            return
        size = self.path.stat().st_size if self.path.is_file() else 0
        _bound_memory(_INDEX_BYTES + _TIMES_LARGER * size)
        self._index = read_index(self.path)
        self._parent.send(_packed(self._index, read_tags(self.path)))

    def _show(self, found: tuple[int, NDArray[np.uint8]] | None) -> None:
        if found is None:
            self._parent.send(_NoMore())
            return
        self._image[:] = found[1]
        self._parent.send(_Decoded(found[0]))


def _bound_memory(most_bytes: int) -> None:
    """Bound what is taken from here on."""
    bound(resource.RLIMIT_AS, psutil.Process().memory_info().vms + most_bytes)


def _end_with(parent_id: int) -> None:
    """End where the parent is gone, also in the middle of a film that has FFmpeg go on for ever."""
    while os.getppid() == parent_id:
        time.sleep(_ORPHAN_S)
    os._exit(1)


def main() -> None:
    """Answer requests until there are no more."""
    bound(resource.RLIMIT_CORE, 0)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    parent: MessageChannel[_Request] = connect_to_parent(_Request, most_bytes=_MAX_MESSAGE)
    film = _FilmWorker(parent)
    with suppress(EOFError, OSError):  # nobody waits any more
        while (request := parent.receive()) is not None:
            try:
                film.answer(request)
            except VideoError as error:
                parent.send(_NotRead(plain(str(error))))
            except (av.FFmpegError, ValueError, MemoryError) as error:
                why = "it takes more memory than a film may" if isinstance(error, MemoryError) else reason(error)
                parent.send(_NotRead(plain(f"video {film.path}: {why}")))


if __name__ == "__main__":
    main()
