"""Who holds a port, on a system made of files."""

from __future__ import annotations

from pathlib import Path

import pytest

import mavlink.links.port_owner
from mavlink.links.port_owner import owner_of

PORT = 14550
TABLE = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"


def holds(proc: Path, process_id: int, *, name: str = "python", start_ticks: int, inode: int = 77) -> None:
    """A process with one socket, as proc(5) shows it."""
    (proc / f"{process_id}" / "fd").mkdir(parents=True)
    (proc / f"{process_id}" / "fd" / "5").symlink_to(f"socket:[{inode}]")
    (proc / f"{process_id}" / "comm").write_text(f"{name}\n")
    fields = ["S", *["0"] * 18, f"{start_ticks}", *["0"] * 30]
    (proc / f"{process_id}" / "stat").write_text(f"{process_id} ({name}) {' '.join(fields)}\n")


@pytest.fixture
def proc(tmp_path, monkeypatch):
    (tmp_path / "net").mkdir()
    row = f"   1: 0100007F:{PORT:04X} 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 77 2 0 0\n"
    (tmp_path / "net" / "udp").write_text(TABLE + row)
    monkeypatch.setattr(mavlink.links.port_owner, "_PROC", tmp_path)
    return tmp_path


@pytest.mark.parametrize("child", [426, 31761], ids=["ids began again", "ids in order"])
def test_a_station_is_named_not_the_process_it_lent_its_socket(proc, child):
    holds(proc, 31760, name="gcs fly", start_ticks=5000)
    holds(proc, child, start_ticks=5004)
    holds(proc, 3, name="somebody else", start_ticks=1, inode=78)
    assert owner_of("udp", PORT) == " by process 31760 (gcs fly)"


def test_a_name_with_brackets_and_foreign_bytes_is_read(proc):
    holds(proc, 9, name="a) S (b 1", start_ticks=7)
    (proc / "9" / "comm").write_bytes(b"a) \xff\n")
    assert owner_of("udp", PORT) == " by process 9 (a) \ufffd)"


def test_nobody_is_named_where_nothing_can_be_told(proc):
    assert owner_of("udp", PORT) == ""
    assert owner_of("udp", PORT + 1) == ""
    assert owner_of("tcp", PORT) == ""
    holds(proc, 9, start_ticks=7)
    (proc / "9" / "stat").unlink()
    assert owner_of("udp", PORT) == ""
