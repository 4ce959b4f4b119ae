"""One attempt at a flight: a job in, its result or what was wrong with it out, and a log of it beside."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from assoc.errors import AssocError
from gcs.batch.jobs import SCRATCH_LOG, FlightDone, FlightFailed, FlightJob, FramesDone
from gcs.batch.work import fetched_path, identify_flight
from gcs.errors import GcsError, StoreError
from infra.processes.channel import MessageChannel
from infra.program_log import LogFile
from infra.secrets import conceal, hide
from mavlink.errors import MavlinkError
from sim.errors import SimError
from vision.errors import VisionError

REPORT_S = 0.5
_INPUT_ERRORS = (GcsError, MavlinkError, VisionError, AssocError, SimError)
_log = logging.getLogger(__name__)


def work_on(job: FlightJob, channel: MessageChannel[FlightJob] | None = None) -> FlightDone | FlightFailed:
    """Work on a flight and log it; no error comes out."""
    hide(job.address)
    hide(job.out)
    due_s = 0.0

    def report(done: int, total: int) -> None:
        nonlocal due_s
        if channel is not None and time.monotonic() >= due_s:
            due_s = time.monotonic() + REPORT_S
            channel.send(FramesDone(done, total))

    if channel is not None:
        channel.send(FramesDone(0, 0))
    log = LogFile(Path(job.scratch) / SCRATCH_LOG)
    try:
        done = identify_flight(job, report)
        _log.info("done: %s frames, %s of %s named", done.record.frames, done.record.named, done.record.vehicles)
        return done
    except StoreError as error:
        return _failed(job, str(error), again=True)
    except _INPUT_ERRORS as error:
        return _failed(job, str(error), again=False)
    except Exception as error:  # noqa: BLE001 - goes to the flight's log and record
        _log.exception("a fault of this program")
        return _failed(job, f"a fault of this program, see the flight's log: {error!r}", again=True)
    finally:
        log.close()


def _failed(job: FlightJob, text: str, *, again: bool) -> FlightFailed:
    line = conceal(" ".join(text.replace(str(fetched_path(job)), job.address).split()))
    _log.error("%s", line)
    return FlightFailed(line, again=again)
