"""Who holds a port."""

import os
import socket
import subprocess
import sys
from types import SimpleNamespace

import psutil
import pytest

from mavlink.links.port_owner import owner_of
from tests.support.ports import free_port

HOST = "127.0.0.1"
PORT = 14550
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell everybody")


class Held:
    """A process with one UDP socket, as psutil shows it."""

    def __init__(self, pid, *, name="python", began_s, port=PORT, error=None):
        self.pid, self._name, self._began_s, self._port, self._error = pid, name, began_s, port, error

    def net_connections(self, kind):
        if self._error:
            raise self._error
        unbound, bound = SimpleNamespace(laddr=()), SimpleNamespace(laddr=SimpleNamespace(port=self._port))
        return [unbound, bound] if kind == "udp4" else []

    def create_time(self):
        return self._began_s

    def name(self):
        return self._name


@pytest.fixture
def processes(monkeypatch):
    held = []
    monkeypatch.setattr(psutil, "process_iter", lambda: iter(held))
    return held


@pytest.mark.parametrize("child", [426, 31761], ids=["ids began again", "ids in order"])
def test_a_station_is_named_not_the_process_it_lent_its_socket(processes, child):
    processes += [
        Held(3, name="somebody else", began_s=1.0, port=PORT + 1),
        Held(child, began_s=50.04),
        Held(31760, name="gcs fly", began_s=50.0),
    ]
    assert owner_of("udp", PORT) == " by process 31760 (gcs fly)"


def test_a_name_with_brackets_and_foreign_bytes_is_one_plain_line(processes):
    processes.append(Held(9, name="a) \udcff\n", began_s=7.0))
    assert owner_of("udp", PORT) == " by process 9 (a) \ufffd\ufffd)"


def test_nobody_is_named_where_nothing_can_be_told(processes):
    assert owner_of("udp", PORT) == ""
    for error in (psutil.AccessDenied(9), psutil.NoSuchProcess(9), PermissionError()):
        processes[:] = [Held(9, began_s=7.0, error=error)]
        assert owner_of("udp", PORT) == ""
    processes[:] = [Held(9, began_s=7.0)]
    assert owner_of("udp", PORT + 1) == "" == owner_of("tcp", PORT)


@LINUX
def test_a_socket_that_was_handed_to_a_child_is_this_process_s():
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, port))
        wait = "import sys; sys.stdin.read()"
        with subprocess.Popen([sys.executable, "-c", wait], stdin=subprocess.PIPE, pass_fds=[sock.fileno()]) as child:
            told = owner_of("udp", port)
            child.stdin.close()
    assert told.startswith(f" by process {os.getpid()} (")
