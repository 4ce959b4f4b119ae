"""Logs by the writers of others, of the made-up drive, each with a few of the troubles that users report.

As a program, since pymavlink's reader changes the process that loads it: ``python foreign_logs.py FOLDER COUNT``.
"""

from __future__ import annotations

import io
import os
import random
import struct
import sys
import tempfile
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect
from pyulog import ULog

sys.path[:0] = [str(Path(__file__).parents[3])]
from tests.support.imports.log_writers import dataflash, ulog  # noqa: E402 - this is a program too
from tests.support.imports.straight import PITCH, ROLL, N, Straight  # noqa: E402


def _clock_set(drive: Straight, rng: random.Random) -> None:
    """The recorder's clock, or GPS time, is set."""
    drive.t_us[rng.randrange(9, N - 9) :] += round(
        rng.choice((rng.uniform(-60.0, -2.0), rng.uniform(2.0, 4000.0))) * 1e6
    )


def _started_again(drive: Straight, rng: random.Random) -> None:
    drive.boot_us[rng.randrange(9, N - 9) :] -= 77_000_000


def _place_damaged(drive: Straight, rng: random.Random) -> None:
    drive.lat[rng.randrange(9, N - 9)] += rng.uniform(0.01, 30.0)


def _no_fix(drive: Straight, rng: random.Random) -> None:
    upto = rng.randrange(1, N // 2)
    drive.lat[:upto] = drive.lon[:upto] = 0.0


def _altitude_damaged(drive: Straight, rng: random.Random) -> None:
    drive.alt_m[rng.randrange(9, N - 9)] = rng.choice((0.0, -500.0, 6000.0))


def _gap(drive: Straight, rng: random.Random) -> None:
    at, by_us = rng.randrange(9, N - 9), round(rng.uniform(2.0, 100.0) * 1e6)
    drive.t_us[at:] += by_us
    drive.boot_us[at:] += by_us


def _date_of_1970(drive: Straight, rng: random.Random) -> None:
    drive.t_us[: rng.randrange(1, N // 3)] -= 1_760_000_000_000_000


TROUBLES = (_clock_set, _started_again, _place_damaged, _no_fix, _altitude_damaged, _gap)


def _tlog(drive: Straight, rng: random.Random) -> bytes:
    """By pymavlink's encoder, in version 1 or 2, with a companion that reports another place."""
    stream = io.BytesIO()
    speakers = [dialect.MAVLink(stream, srcSystem=11, srcComponent=component) for component in (1, 191)]
    first = rng.random() < 0.5
    for k in drive.order.tolist():
        boot_ms = int(drive.boot_us[k]) // 1000
        place = [round(v * 1e7) for v in (drive.lat[k], drive.lon[k])]
        heights = round(drive.alt_m[k] * 1e3), round(drive.height_m[k] * 1e3)
        yaw = float(drive.yaw[k])
        for speaker, off in zip(speakers, (0, 10_000), strict=True):
            for message in (
                speaker.heartbeat_encode(10, 3 if not off else 8, 0, 0, 4),
                speaker.global_position_int_encode(boot_ms, place[0] + off, place[1], *heights, 178, 60, 0, 65535),
                speaker.attitude_encode(boot_ms, ROLL, PITCH, yaw, 0.0, 0.0, 0.0),
            ):
                # of a companion only where it is
                if off and message.get_type() != "GLOBAL_POSITION_INT":
                    continue
                stream.write(struct.pack(">Q", max(0, int(drive.t_us[k]))))
                speaker.send(message, force_mavlink1=first)
    return stream.getvalue()


def _ulog(drive: Straight, rng: random.Random) -> bytes:
    """By pyulog's writer."""
    with tempfile.TemporaryDirectory() as folder:
        made, written = Path(folder) / "made.ulg", Path(folder) / "written.ulg"
        made.write_bytes(ulog(drive, 11))
        ULog(str(made)).write_ulog(str(written))
        return written.read_bytes()


def _bin(drive: Straight, rng: random.Random) -> bytes:
    """By the records that pymavlink's reader packs again, as ``mavlogdump`` does."""
    from pymavlink.DFReader import DFReader_binary

    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "made.bin"
        made.write_bytes(dataflash(drive, 11, receiver=rng.randrange(2), core=rng.randrange(2)))
        reader, packed = DFReader_binary(str(made)), []
        while record := reader.recv_msg():
            packed.append(record.get_msgbuf() or b"")
        return b"".join(packed)


WRITERS = {"tlog": _tlog, "ulg": _ulog, "bin": _bin}


def foreign_log(seed: int) -> tuple[str, bytes]:
    """Suffix and bytes of a log with up to two troubles, cut or damaged in some places, or twice in one file."""
    rng = random.Random(seed)
    drive, suffix = Straight(), tuple(WRITERS)[seed % len(WRITERS)]
    for trouble in rng.sample((*TROUBLES, *((_date_of_1970,) if suffix == "tlog" else ())), rng.randrange(3)):
        trouble(drive, rng)
    data = bytearray(WRITERS[suffix](drive, rng))
    for _ in range(rng.randrange(3)):
        at = rng.randrange(len(data))
        if rng.random() < 0.5:
            data[at : at + rng.randrange(1, 300)] = rng.randbytes(rng.randrange(300))
        elif rng.random() < 0.3:
            del data[max(len(data) // 2, at) :]
    if rng.random() < 0.2:
        data *= 2
    return suffix, bytes(data)


if __name__ == "__main__":
    os.environ.setdefault("HOME", tempfile.gettempdir())
    for number in range(int(sys.argv[2])):
        kind, content = foreign_log(number)
        (Path(sys.argv[1]) / f"{number}.{kind}").write_bytes(content)
