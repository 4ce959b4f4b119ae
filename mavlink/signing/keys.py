"""Signing keys: a folder with one file for each vehicle, read once and never shown.

``7.key`` holds the key of system 7, ``fleet.key`` one for every system without its own: 32 bytes, as 64 hexadecimal
digits. Only their owner may read them. A file is never overwritten: a vehicle whose key is lost is locked.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from infra.files.safe_open import open_to_read
from mavlink.errors import SigningError

FLEET = 0
"""Word in place of a system id: the key of all systems that have none of their own."""
KEY_LENGTH = 32
SIGNATURE_BYTES = 6
_POSIX = os.name == "posix"


class Key:
    """A secret of 32 bytes that signs and cannot be read back.

    The bytes are not kept, only the state of SHA-256 after them, which can be neither printed nor pickled.

    Raises:
        SigningError: not 32 bytes, or all zero, which autopilots take for "signing is off".
    """

    __slots__ = ("_primed", "fingerprint")

    def __init__(self, secret: bytes) -> None:
        length, zero = len(secret), not any(secret)
        if length != KEY_LENGTH or zero:
            del secret  # a traceback may show local variables
            raise SigningError("a key of zeros is none" if zero else f"a key has {KEY_LENGTH} bytes, not {length}")
        self._primed = hashlib.sha256(secret)
        self.fingerprint = hashlib.sha256(b"rollcall fingerprint" + secret).hexdigest()[:8]
        """Identifies the key without revealing it."""

    def signature(self, covered: bytes) -> bytes:
        """The six bytes that end a signed frame.

        SHA-256(key + header + payload + checksum + link id + timestamp), cut to 48 bits
        (https://mavlink.io/en/guide/message_signing.html).

        Args:
            covered: the frame from its magic byte to its timestamp.
        """
        digest = self._primed.copy()
        digest.update(covered)
        return digest.digest()[:SIGNATURE_BYTES]

    def __repr__(self) -> str:
        return f"Key({self.fingerprint})"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyRing:
    """The signing keys of a fleet."""

    keys: Mapping[int, Key] = field(default_factory=dict)
    """Keys by system id, 1..255."""
    default: Key | None = None
    """Key of every system without a key of its own."""

    def key_of(self, system_id: int) -> Key | None:
        """The key that this system's frames are verified with, None without one."""
        return self.keys.get(system_id, self.default)

    def __len__(self) -> int:
        return len(self.keys) + (self.default is not None)


def passphrase_secret(passphrase: str) -> bytes:
    """The 32 bytes of a passphrase, as other ground stations derive them: SHA-256 of its UTF-8."""
    return hashlib.sha256(passphrase.encode("utf-8", "surrogateescape")).digest()


def key_path(folder: Path, system_id: int) -> Path:
    """The file of a system's key, or of the fleet's."""
    return folder / ("fleet.key" if system_id == FLEET else f"{system_id}.key")


def read_ring(folder: Path) -> KeyRing:
    """Read every key of a folder; a folder without keys gives an empty ring.

    Raises:
        SigningError: no such folder, files that others may read or replace, or that hold no key.
    """
    try:
        _check_permissions(folder)
        paths = sorted(path for path in folder.iterdir() if path.suffix == ".key")
    except OSError as error:
        hint = "; make a key with gcs keys new" if isinstance(error, FileNotFoundError) else ""
        raise SigningError(f"{folder}: the key folder cannot be read: {error.strerror}{hint}") from None
    keys = {_system_id_of(path): _read_key(path) for path in paths}
    return KeyRing(default=keys.pop(FLEET, None), keys=keys)


def write_key(folder: Path, system_id: int, secret: bytes) -> tuple[Path, Key]:
    """Put a key into a folder, readable by its owner only; make the folder if needed.

    Raises:
        SigningError: there is one already, or it cannot be written.
    """
    path = key_path(folder, system_id)
    key, text = Key(secret), secret.hex() + "\n"
    del secret
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        del text
        if isinstance(error, FileExistsError):
            raise SigningError(f"{path}: exists already, and keys are never overwritten; move it away first") from None
        raise SigningError(f"{path}: cannot be made: {error.strerror}") from None
    failure = ""
    try:
        os.write(fd, text.encode())
        os.fsync(fd)
    except OSError as error:
        failure = error.strerror or "unknown error"
    finally:
        del text
        os.close(fd)
    if failure:
        path.unlink()
        raise SigningError(f"{path}: cannot be written: {failure}")
    return path, key


def remove_key(folder: Path, system_id: int) -> tuple[Path, str]:
    """Take a key out of a folder for good.

    Returns:
        Where it was, and its fingerprint.

    Raises:
        SigningError: there is none, or it cannot be removed.
    """
    path = key_path(folder, system_id)
    fingerprint = _read_key(path).fingerprint
    try:
        path.unlink()
    except OSError as error:
        raise SigningError(f"{path}: cannot be removed: {error.strerror}") from None
    return path, fingerprint


def _system_id_of(path: Path) -> int:
    if path.stem == "fleet":
        return FLEET
    if path.stem.isascii() and path.stem.isdigit() and 1 <= int(path.stem) <= 255 and str(int(path.stem)) == path.stem:
        return int(path.stem)
    raise SigningError(f"{path}: whose key is this? Name it after its system id, 1.key to 255.key, or fleet.key")


def _check_permissions(folder: Path) -> None:
    mode = stat.S_IMODE(folder.stat().st_mode)
    if _POSIX and mode & 0o022:
        raise SigningError(
            f"{folder}: others may change the keys in it (mode {mode:03o}); run: chmod 700 {shlex.quote(str(folder))}"
        )


def _read_key(path: Path) -> Key:
    with _opened(path) as file:
        mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
        if _POSIX and mode & 0o077:
            raise SigningError(
                f"{path}: others may read this key (mode {mode:03o}); run: chmod 600 {shlex.quote(str(path))}"
            )
        secret = _from_hex(file.read(200))
    if len(secret) != KEY_LENGTH or not any(secret):
        del secret
        raise SigningError(f"{path}: holds no key; it must be {2 * KEY_LENGTH} hexadecimal digits, not all 0")
    return Key(secret)


def _opened(path: Path) -> BinaryIO:
    try:
        return os.fdopen(open_to_read(path), "rb")
    except OSError as error:
        raise SigningError(f"{path}: cannot be read: {error.strerror}") from None


def _from_hex(text: bytes) -> bytes:
    """The bytes of hexadecimal digits; empty for anything else."""
    try:
        return bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        return b""
