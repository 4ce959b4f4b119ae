"""The UAV's log inside the video: whatever it carries that tells where the camera was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gcs.errors import ImportFileError
from gcs.importing.checks.plausible import plausible
from gcs.importing.formats.dji_srt import log_of_cues
from gcs.importing.formats.film_streams import FilmStreams, read_streams
from gcs.importing.formats.klv import log_of_klv
from gcs.importing.formats.sei import TELEMETRY_UUID, log_of_messages
from gcs.importing.formats.siyi import is_siyi, siyi_log
from gcs.importing.vehicle_log import VehicleLog


def read_film_log(path: Path, *, coarse: bool) -> tuple[VehicleLog | None, tuple[str, ...]]:
    """The best log that a video carries, None without any, and what it carries that cannot be read.

    Args:
        coarse: take one with positions to 3 m too.

    Raises:
        VideoError: not a video that can be read.
    """
    streams = read_streams(path)
    troubles = list(streams.unread)
    for read in (_messages, _klv, _cues):
        try:
            log = read(path.name, streams, coarse=coarse)
        except ImportFileError as error:
            troubles.append(str(error))
            continue
        if log is not None:
            if streams.dropped:
                skipped = {**log.notes.skipped, "messages beyond what is kept": streams.dropped}
                log = replace(log, notes=replace(log.notes, skipped=skipped))
            return plausible(log), tuple(troubles)
    return None, tuple(troubles)


def _messages(name: str, streams: FilmStreams, *, coarse: bool) -> VehicleLog | None:
    if not any(message.data.startswith(TELEMETRY_UUID) for message in streams.messages):
        return None
    return log_of_messages(name, streams.messages)


def _klv(name: str, streams: FilmStreams, *, coarse: bool) -> VehicleLog | None:
    return log_of_klv(name, streams.klv) if streams.klv else None


def _cues(name: str, streams: FilmStreams, *, coarse: bool) -> VehicleLog | None:
    if not streams.cues:
        return None
    if is_siyi(streams.cues):
        return siyi_log(name, streams.cues) if coarse else None
    return log_of_cues(name, streams.cues)
