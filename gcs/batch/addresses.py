"""Addresses of files: paths of this machine, and those with a protocol, which fsspec reads.

Options of a store are taken from where its own tools take them, such as ``AWS_ENDPOINT_URL`` and ``AWS_PROFILE``, and
from fsspec's own settings (``FSSPEC_S3_ANON`` and the like).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gcs.errors import StoreError
from infra.secrets import conceal, conceal_in, concealed

_MAX_SHOWN, _MAX_REASON = 200, 500
"""Maximum number of letters in an error of an address, and of what a store says."""
_LOCAL = ("file", "local")
_WEB = ("http", "https")
_MAGIC = frozenset("*?[")
_OF_THIS_PROCESS = ("memory",)
"""Protocols that no other process can read."""


def _protocol(address: str) -> str:
    protocol, found, _ = address.partition("://")
    return protocol if found else ""


def is_remote(address: str) -> bool:
    """Tell whether fsspec is to read it."""
    return _protocol(address) not in ("", *_LOCAL)


def is_of_this_process(address: str) -> bool:
    """Tell whether no other process sees what is there."""
    return _protocol(address) in _OF_THIS_PROCESS


def is_pattern(address: str) -> bool:
    """Tell whether it stands for several; on the web a ? begins what an address was signed with."""
    return bool(_MAGIC & set(_place(address)))


def last_part(address: str) -> str:
    """The name of the file or folder at an address."""
    return _place(address).rstrip("/").rpartition("/")[2]


def _place(address: str) -> str:
    return re.split("[?#]", address, maxsplit=1)[0] if _protocol(address).endswith(_WEB) else address


def local_path(address: str) -> Path:
    """The path of an address that is not remote."""
    return Path(address.partition("://")[2] if _protocol(address) in _LOCAL else address)


def remote_files(address: str) -> tuple[Any, str]:
    """fsspec's file system of an address, and the path in it.

    Raises:
        StoreError: fsspec, or what it needs for this protocol, is not installed, or knows no such protocol; or it is a
            file of references, whose author chooses what is read in its place.
    """
    if any(part.partition("://")[0] == "reference" for part in address.split("::")):
        raise StoreError(f"{_shown(address)}: leads to addresses that another chose; give those of the flights")
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise StoreError(f"{_shown(address)}: needs fsspec: pip install 'rollcall-gcs[batch]'") from None
    with store_errors(address):
        files, path = url_to_fs(address)
    return files, path


@contextlib.contextmanager
def store_errors(address: str) -> Iterator[None]:
    """Turn what a store raises into one line that names the address.

    Raises:
        StoreError: in place of any other error.
    """
    shown = _shown(address)
    try:
        yield
    except FileNotFoundError as error:
        raise StoreError(f"{shown}: no such file or folder") from error
    except Exception as error:
        reason = conceal(conceal_in(" ".join(str(error).split()), address))
        raise StoreError(f"{shown}: {reason[:_MAX_REASON] or type(error).__name__}") from error


def _shown(address: str) -> str:
    return concealed(address)[:_MAX_SHOWN]
