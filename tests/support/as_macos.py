"""Python on Linux made to look like Python on macOS, for the product's own modules; for processes of their own.

Libraries are loaded before, as what they are: their macOS builds are their authors' care.
"""

from __future__ import annotations

import ctypes
import fcntl
import importlib
import mmap
import os
import pkgutil
import re
import resource
import select
import signal
import socket
import sys
import time

LIBRARIES = (
    *("av", "cv2", "fastcrc", "msgspec", "numpy", "onnxruntime", "psutil", "pymavlink.dialects.v20.ardupilotmega"),
    *("pyproj", "rich.progress", "rich.table", "scipy.optimize", "serial", "textual.app", "textual_image", "tomli_w"),
    *("typer", "typer.testing", "textual.drivers.linux_driver", "textual.widgets", "scipy.stats", "scipy.special"),
)
LINUX_ONLY = {
    os: r"sched_\w+|SCHED_\w+|memfd_create|MFD_\w+|eventfd\w*|EFD_\w+|pidfd_\w+|posix_fa\w+|POSIX_FADV_\w+|fdatasync|"
    r"getrandom|GRND_\w+|pipe2|splice|SPLICE_\w+|copy_file_range|\w+xattr|XATTR_\w+|setns|unshare|CLONE_\w+|\w+resuid|"
    r"O_(TMPFILE|PATH|DIRECT|NOATIME|LARGEFILE|RSYNC)|RWF_\w+",
    socket: r"AF_(PACKET|NETLINK|CAN|VSOCK|ALG|TIPC|RDS|BLUETOOTH)|SOCK_(CLOEXEC|NONBLOCK)|SCM_CRED\w+|"
    r"SO_(BINDTODEVICE|MARK|PRIORITY|PROTOCOL|DOMAIN|PEER\w+|PASS\w+|INCOMING_CPU)|MSG_(CMSG_CLOEXEC|CONFIRM|ERRQUEUE|"
    r"FASTOPEN|MORE|NOSIGNAL)|TCP_(CORK|INFO|QUICKACK|USER_TIMEOUT|DEFER_ACCEPT|LINGER2|SYNCNT|KEEPIDLE)|IPX?_RECVTOS",
    signal: r"SIG(PWR|STKFLT|POLL|CLD|RTMIN|RTMAX)|sigtimedwait|sigwaitinfo|pidfd_send_signal",
    select: r"epoll|EPOLL\w+",
    time: r"CLOCK_(BOOTTIME|TAI|\w+COARSE)|pthread_getcpuclockid",
    mmap: r"MAP_(POPULATE|LOCKED|STACK|DENYWRITE|EXECUTABLE)|"
    r"MADV_(HUGEPAGE|NOHUGEPAGE|MERGEABLE|DONTFORK|REMOVE|POPULATE\w*)",
    fcntl: r"F_(OFD_\w+|\w+PIPE_SZ|ADD_SEALS|GET_SEALS|SEAL_\w+|NOTIFY|SETSIG|GETSIG|SETLEASE|GETLEASE)|DN_\w+",
    resource: r"prlimit|RLIMIT_(MSGQUEUE|NICE|OFILE|RTPRIO|RTTIME|SIGPENDING)|RUSAGE_THREAD",
}
NOT_IN_LIBC = {"recvmmsg", "sendmmsg", "prctl", "adjtimex", "sync_file_range", "fallocate", "renameat2", "memfd_create"}
ABSENT = ("/proc", "/dev/shm", "/sys")


def become_macos() -> None:
    """Take away what only Linux has."""
    for name in LIBRARIES:
        importlib.import_module(name)
    for module, names in LINUX_ONLY.items():
        for name in [name for name in dir(module) if re.fullmatch(names, name)]:
            delattr(module, name)
    real_symbol, real_stat = ctypes.CDLL.__getattr__, os.stat

    def symbol(library, name):
        if name in NOT_IN_LIBC:
            raise AttributeError(name)
        return real_symbol(library, name)

    def stat(path, *more, **options):
        _refuse(path)
        return real_stat(path, *more, **options)

    def _refuse(path):
        if isinstance(path, str | os.PathLike) and os.fspath(path).startswith(ABSENT):
            raise FileNotFoundError(2, "No such file or directory", path)

    ctypes.CDLL.__getattr__ = symbol
    os.stat = stat
    sys.addaudithook(lambda event, words: _refuse(words[0]) if event in ("open", "os.listdir") else None)
    sys.platform = "darwin"


def import_everything() -> int:
    """Import every module of the product, and count them; libraries for training networks may be absent."""
    count = 0
    for package in ("gcs", "mavlink", "vision", "assoc", "infra", "sim", "training"):
        for found in pkgutil.walk_packages([package], f"{package}."):
            if found.name.endswith("__main__"):
                continue
            try:
                importlib.import_module(found.name)
            except ModuleNotFoundError as error:
                if error.name not in ("torch", "onnx") or not found.name.startswith("training."):
                    raise
            count += 1
    return count
