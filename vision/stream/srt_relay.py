"""SRT received by an ``ffmpeg`` program: the one inside PyAV is built without it.

The program hands on the bytes as they come and interprets nothing. It ends by itself once nobody reads from it, once
its sender is away, or when nobody has connected for ``LISTEN_S``.
"""

from __future__ import annotations

import errno
import functools
import os
import select
import shutil
import subprocess
from collections.abc import Iterator
from urllib.parse import parse_qsl, urlencode, urlsplit

from infra.secrets import concealed
from vision.errors import VideoError

KEYS = ("mode", "latency", "streamid")
"""Options of an address that are passed on, as FFmpeg has them: latency in µs."""
LISTEN_S = 35
LATENCY_S = 0.12
"""Time for which SRT keeps what came, in case something has to be sent again, where the address has no other."""
ASK_S = 10.0
READ_BYTES = 32768
NO_PROGRAM = (
    "SRT needs an ffmpeg program that is built with it: pip install 'rollcall-gcs[srt]', or have the sender push RTMP "
    "to rtmp://0.0.0.0:1935/live, or send MPEG-TS over UDP"
)


def relayed_address(text: str, any_host: tuple[str, ...]) -> tuple[str, bool]:
    """The address as the program takes it, and whether others connect to it.

    Raises:
        VideoError: no port, or an option that is not passed on.
    """
    shown = concealed(text)
    try:
        parts = urlsplit(text)
        port, host = parts.port, parts.hostname or ""
    except ValueError:
        port, host = None, ""
    if not port:
        raise VideoError(f"video {shown}: not an address; write for example srt://0.0.0.0:9000")
    options = dict(parse_qsl(parts.query))
    if "passphrase" in options:
        raise VideoError(
            f"video {shown}: a passphrase would stand in this computer's list of processes; send without one, or RTMPS"
        )
    if unknown := [key for key in options if key not in KEYS]:
        raise VideoError(f"video {shown}: {unknown[0]!r} is not passed on to SRT; known are {', '.join(KEYS)}")
    mode = options.setdefault("mode", "listener" if host in any_host else "caller")
    if mode == "listener":
        options |= {"listen_timeout": str(LISTEN_S * 1_000_000)}
    place = f"[{host}]" if ":" in host else host or "0.0.0.0"
    return f"srt://{place}:{port}?{urlencode(options)}", mode == "listener"


def kept_back_s(address: str) -> float:
    """The time for which our side of an SRT connection keeps back what came, at least, seconds."""
    latency_us = dict(parse_qsl(urlsplit(address).query)).get("latency", "")
    return 1e-6 * int(latency_us) if latency_us.isascii() and latency_us.isdecimal() else LATENCY_S


class SrtRelay:
    """Bytes of one SRT connection.

    Args:
        address: as :func:`relayed_address` has it.
        timeout: longest wait for the first bytes, and for further ones, seconds.

    Raises:
        VideoError: there is no program that can.
        OSError: it is not started.
    """

    def __init__(self, address: str, timeout: tuple[float, float]) -> None:
        self._timeout = timeout
        words = ("-nostdin", "-hide_banner", "-loglevel", "error", "-protocol_whitelist", "srt", "-f", "data")
        self._process = subprocess.Popen(
            [
                ffmpeg_program(),
                *words,
                "-i",
                address,
                "-map",
                "0",
                "-c",
                "copy",
                "-f",
                "data",
                "-flush_packets",
                "1",
                "pipe:1",
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def demux(self) -> Iterator[bytes]:
        """Bytes as they come, until the sender ends.

        Raises:
            OSError: nothing comes for longer than is waited for, or nobody is there.
        """
        assert self._process.stdout is not None
        line, patience_s = self._process.stdout.fileno(), self._timeout[0]
        while select.select([line], [], [], patience_s)[0]:
            data = os.read(line, READ_BYTES)
            if not data and patience_s == self._timeout[0]:
                raise ConnectionRefusedError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED))
            if not data:
                return
            yield data
            patience_s = self._timeout[1]
        raise TimeoutError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))

    def close(self) -> None:
        """Hang up."""
        self._process.kill()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


@functools.cache
def ffmpeg_program() -> str:
    """An ffmpeg program that can, the system's or that of the extra.

    Raises:
        VideoError: there is none.
    """
    for path in (shutil.which("ffmpeg"), _packaged()):
        if path and "srt" in _protocols(path):
            return path
    raise VideoError(NO_PROGRAM)


def _packaged() -> str | None:
    """The program of the package imageio-ffmpeg, which is an extra."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        return None
    try:
        return str(get_ffmpeg_exe())
    except RuntimeError:
        return None


def _protocols(path: str) -> list[str]:
    try:
        asked = subprocess.run([path, "-hide_banner", "-protocols"], capture_output=True, timeout=ASK_S, text=True)
    except (OSError, subprocess.SubprocessError):
        return []
    return asked.stdout.split()
