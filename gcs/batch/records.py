"""The record of each flight in a folder of results, and the table of all of them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import unquote

import msgspec

from gcs.batch.flights_table import flights_table, read_flights
from gcs.batch.jobs import DONE, FLIGHTS_TABLE, RECORDS, FlightRecord, record_name
from gcs.batch.stores import ResultStore
from gcs.errors import BatchError

READERS = 16
"""Records that are read at once: a store takes its time for each."""
_log = logging.getLogger(__name__)


def read_record(results: ResultStore, flight: str) -> FlightRecord | None:
    """The record of a flight, None where there is none that can be read: its flight is then done again.

    Raises:
        StoreError: the store does not answer.
    """
    data = results.read(record_name(flight))
    if data is None:
        return None
    try:
        return msgspec.json.decode(data, type=FlightRecord)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        _log.warning("%s: the record in %s cannot be read", flight, results.address)
        return None


def write_record(results: ResultStore, record: FlightRecord) -> None:
    """Put a flight's record into place.

    Raises:
        StoreError: the store does not answer.
    """
    results.write(msgspec.json.format(msgspec.json.encode(record)), record_name(record.flight))


def write_failure(results: ResultStore, record: FlightRecord) -> FlightRecord:
    """Put the record of a flight that failed into place, where no result of an earlier run stands beside it.

    Returns:
        The record; it tells of the earlier result, whose own record stays.

    Raises:
        StoreError: the store does not answer.
    """
    kept = read_record(results, record.flight)
    if kept is not None and kept.status == DONE:
        return msgspec.structs.replace(record, earlier_result=True)
    write_record(results, record)
    return record


def all_records(results: ResultStore, now: Mapping[str, FlightRecord]) -> list[FlightRecord]:
    """Return the records of all flights of which there are results.

    Raises:
        StoreError: the store does not answer.
    """
    data = results.read(FLIGHTS_TABLE)
    try:
        known = {record.flight: record for record in read_flights(data, FLIGHTS_TABLE)} if data else {}
    except BatchError as error:
        _log.warning("%s; it is made anew", error)
        known = {}
    known |= now
    files = (name for name in results.names(RECORDS) if name.endswith(".json"))
    unread = [flight for flight in (unquote(name.removesuffix(".json")) for name in files) if flight not in known]
    with ThreadPoolExecutor(READERS, thread_name_prefix="records") as readers:
        found = readers.map(lambda flight: read_record(results, flight), unread)
        return [*known.values(), *(record for record in found if record is not None)]


def write_table(results: ResultStore, now: Mapping[str, FlightRecord]) -> None:
    """Put the table of all flights into place.

    Raises:
        StoreError: the store does not answer.
        BatchError: pyarrow is not installed.
    """
    results.write(flights_table(all_records(results, now)), FLIGHTS_TABLE)
