"""One batch at a time for a store: an object that tells who writes, written anew every few seconds while it does.

Whose object stands still was killed: another batch takes over after having watched it for a while. No clock is
compared, as those of two machines differ. Where two take over at the same moment nothing is lost but work: results of
the same input are the same bytes.
"""

from __future__ import annotations

import contextlib
import logging
import os
import platform
import threading
import time
import uuid
from collections.abc import Iterator
from typing import Any

import msgspec
import psutil

from gcs.batch.addresses import store_errors
from gcs.errors import StoreError

UNREADABLE = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Errors of a file that others may have written."""
RENEW_S = 10.0
WATCH_S = 30.0
"""A batch that has not renewed its object for so long is over."""
POLL_S = 1.0
_log = logging.getLogger(__name__)


class LockHolder(msgspec.Struct, frozen=True, kw_only=True):
    """Who writes."""

    host: str
    pid: int
    began_s: float
    """When the process began, by its own clock: another process may have its number later."""
    key: str
    """Key of this one batch."""
    renewed: int = 0


@contextlib.contextmanager
def held(files: Any, path: str, address: str) -> Iterator[None]:  # noqa: ANN401 - fsspec has no types
    """Hold a store while a block runs.

    Args:
        files: fsspec's file system.

    Raises:
        StoreError: another batch holds it, or it cannot be written.
    """
    me = LockHolder(host=platform.node(), pid=os.getpid(), began_s=psutil.Process().create_time(), key=uuid.uuid4().hex)
    _take(files, path, address, me)
    done = threading.Event()
    renewing = threading.Thread(target=_renew, args=(files, path, me, done), name="lock", daemon=True)
    renewing.start()
    try:
        yield
    finally:
        done.set()
        renewing.join()
        with contextlib.suppress(Exception):  # what is left stands still, and is taken over
            if (holder := _read(files, path)) and holder.key == me.key:
                files.rm_file(path)


def _take(files: Any, path: str, address: str, me: LockHolder) -> None:  # noqa: ANN401
    stop_s = time.monotonic() + WATCH_S
    first = _read(files, path)
    while first is not None and not _is_dead(first) and time.monotonic() < stop_s:
        time.sleep(min(POLL_S, WATCH_S / 10))
        now = _read(files, path)
        if now is not None and now != first:
            raise StoreError(
                f"{address}: another batch is writing into it (process {now.pid} of {now.host}); wait for its end"
            )
        first = now
    if first is not None:
        _log.warning("%s: process %s of %s left it; taken over", address, first.pid, first.host)
    _write(files, path, me)


def _is_dead(holder: LockHolder) -> bool:
    """Tell whether it is of this machine, and over."""
    if holder.host != platform.node():
        return False
    try:
        return abs(psutil.Process(holder.pid).create_time() - holder.began_s) > 1.0
    except psutil.NoSuchProcess:
        return True


def _renew(files: Any, path: str, me: LockHolder, done: threading.Event) -> None:  # noqa: ANN401
    while not done.wait(RENEW_S):
        try:
            holder = _read(files, path)
            if holder is not None and holder.key != me.key:
                _log.warning("%s: process %s of %s writes there too", path, holder.pid, holder.host)
                return
            me = msgspec.structs.replace(me, renewed=me.renewed + 1)
            _write(files, path, me)
        except Exception as error:  # noqa: BLE001 - the results tell whether the store answers
            _log.warning("%s: not renewed: %s", path, error)


def _write(files: Any, path: str, holder: LockHolder) -> None:  # noqa: ANN401
    with store_errors(path):
        try:
            files.pipe_file(path, msgspec.json.encode(holder))
        except FileNotFoundError:  # of those that have folders
            files.makedirs(path.rpartition("/")[0], exist_ok=True)
            files.pipe_file(path, msgspec.json.encode(holder))


def _read(files: Any, path: str) -> LockHolder | None:  # noqa: ANN401
    """Who holds it; None for nobody, or what is no such object."""
    with store_errors(path), contextlib.suppress(FileNotFoundError, *UNREADABLE):
        files.invalidate_cache()
        return msgspec.json.decode(files.cat_file(path), type=LockHolder)
    return None
