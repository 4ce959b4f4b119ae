"""The frames of a recording as they were coded, without decoding: to copy them into files of other kinds.

A frame's index is that of ``vision.video.video``: its place in display order over all files of the recording. The files
are read in this process, once a process of its own has read them through for their index.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from av.packet import Packet
from av.video.stream import VideoStream

from vision.errors import VideoError
from vision.video.frame_index import coded_packets, film_stream, open_video
from vision.video.recording_parts import read_parts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CodedFrame:
    """One frame, coded."""

    index: int
    """Index in display order."""
    packet: Packet[VideoStream]
    """Packet with the data; its time stamps are those of its own file."""


class CodedFilm:
    """A recorded video to be copied; also the files in which its recording went on.

    Attributes:
        path: the file, the first when there are several.
        stream: of the first file: how all of them are coded.
        n: frames in display order, up to the last one that was recorded.
        size: width and height as it is shown, px.
        turned: the container asks players to turn its pictures; not every other container can.
        shown_as: in words, how its pictures are shown otherwise than they are coded; empty as coded.

    Raises:
        VideoError: no video, or its files are not coded alike, so that one copy cannot hold them.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts = read_parts(path)
        for part in self._parts:
            part.close()
        self.n = self._parts[-1].end
        index = self._parts[0].index
        self.size, self.shown_as = (index.width, index.height), index.shown_as
        self.turned = index.quarter_turns != 0
        if not any(key in index.order for key in index.key_pts.tolist()):
            raise VideoError(f"video {path}: its only key frame is trimmed away, so that it cannot be copied")
        self._open = ExitStack()
        containers = [self._open.enter_context(closing(open_video(part.path))) for part in self._parts]
        self._streams = [(container, film_stream(container)) for container in containers]
        self.stream = self._streams[0][1]
        for part, (_, stream) in zip(self._parts, self._streams, strict=True):
            if _coding(stream) != _coding(self.stream):
                self.close()
                raise VideoError(f"video {part.path}: is coded otherwise than {path}; copy the files one by one")

    def frames(self) -> Iterator[CodedFrame]:
        """All frames in the order in which a decoder needs them, those that no decoder can begin with left out.

        The files are read through; they can be but once.
        """
        for part, (container, stream) in zip(self._parts, self._streams, strict=True):
            for stamp, packet in coded_packets(container, stream):
                index = part.index.order.get(stamp, part.n)
                if index < part.n:
                    yield CodedFrame(index=part.first + index, packet=packet)

    def close(self) -> None:
        """Close the files; call it after the last use of a frame."""
        self._open.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()


def _coding(stream: VideoStream) -> tuple[str, int, int, bytes | None]:
    coded = stream.codec_context
    return coded.name, coded.width, coded.height, coded.extradata
