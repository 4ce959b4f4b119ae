"""A place for an export until it is whole: beside its place, hidden; what breaks off is not taken for it."""

from __future__ import annotations

import errno
import os
import sqlite3
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs.errors import SessionError
from infra.files.aside import make_aside, put_in_place, remove_aside
from infra.files.disk import OF_THE_DISK
from infra.plain_text import plain


@contextmanager
def writing_to(place: Path) -> Iterator[None]:
    """Errors of the disk, as each library tells them, name the place that is written to.

    Raises:
        OSError: in their place.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(errno.EIO, plain(str(error)), str(place)) from error
    except OSError as error:
        if error.errno not in OF_THE_DISK:
            raise
        raise OSError(error.errno, os.strerror(error.errno), str(place)) from error


class Unfinished:
    """A file or a folder that gets its name when it is whole; if it never is, it is removed with this object.

    Args:
        place: of the file or folder; must not exist.
        name: that it has meanwhile, for those who name what they write within after it.

    Raises:
        SessionError: it exists, or nothing can be written there.
    """

    def __init__(self, place: Path, name: str = "unfinished") -> None:
        self._place = place
        if place.exists() or place.is_symlink():
            raise _exists(place)
        try:
            self._hidden = make_aside(place.parent)
        except OSError as error:
            raise SessionError(f"{place}: cannot be written: {error.strerror}") from error
        self._remove = weakref.finalize(self, remove_aside, self._hidden)
        self.path = self._hidden / name
        """Path to make and fill."""

    def finish(self) -> None:
        """Put the finished file into its place.

        Raises:
            SessionError: something came to be there meanwhile, or it cannot be put there.
        """
        try:
            if self.path.is_dir():
                self._place.mkdir()
                self.path.rename(self._place)  # over the empty folder that was made just now, never over another
            else:
                put_in_place(self.path, self._place)
        except FileExistsError:
            raise _exists(self._place) from None
        except OSError as error:
            raise SessionError(f"{self._place}: cannot be written: {error.strerror}") from error
        self._remove()


def _exists(place: Path) -> SessionError:
    return SessionError(f"{place}: exists already and is never overwritten; choose another place")
