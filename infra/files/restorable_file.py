"""A file that a library writes, made here and held open beside it.

A library by itself would write over what is there, and through a link. When the file is deleted, moved or unmounted, it
is put back.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from pathlib import Path

LOOK_S = 0.5
JOIN_S = 1.5


class RestorableFile:
    """New file that is put back when it is deleted, moved or unmounted.

    Attributes:
        error: why it could not be put back, empty while it could.

    Raises:
        OSError: something of that name is there, or it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.error = ""
        self._file = path.open("x+b", buffering=0)
        self._looked_s = time.monotonic()
        self._copying: threading.Thread | None = None

    @property
    def name(self) -> str:
        """Path under which a library opens this file and no other, while it is held here."""
        return f"/dev/fd/{self._file.fileno()}"

    def is_gone(self) -> bool:
        """Tell whether the file is no longer at its path; checked twice a second."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOK_S:
            return False
        self._looked_s = now_s
        gone = not os.fstat(self._file.fileno()).st_nlink or not self.path.exists()
        # a link in the folder's place leads to what is another's
        return gone and not self.path.parent.is_symlink()

    def restore(self) -> None:
        """Copy what was written so far to where it was, in a thread of its own; then let go of it."""
        self._copying = threading.Thread(target=self._copy, name="put back", daemon=True)
        self._copying.start()

    def close(self) -> None:
        """Let go, once it is put back where that was asked for."""
        if self._copying is None:
            self._file.close()
        else:
            self._copying.join(JOIN_S)

    def _copy(self) -> None:
        try:
            with self._file:
                self.path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
                self._file.seek(0)
                with self.path.open("xb") as new:
                    shutil.copyfileobj(self._file, new, 1 << 20)
        except OSError as error:
            self.error = f"recording {self.path}: deleted, and cannot be put back, {error.strerror}"
