"""Sockets and receiving processes that end with their test, and property tests that judge alike on every machine."""

import gc
import os
import socket

import pytest
from hypothesis import HealthCheck, settings
from textual.css.stylesheet import Stylesheet

from gcs.cli.attach.place import VARIABLES
from mavlink.ingest.ingest import Ingest
from tests.support.ports import free_port
from tests.support.receiving import HOST

# A busy machine is slow, not wrong: no example is timed. Neither does luck decide: the examples are the same in every
# run, and few; `--hypothesis-profile=search` looks for others.
settings.register_profile("search", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("same", settings.get_profile("search"), derandomize=True, database=None, max_examples=40)
settings.load_profile("same")

# Thousands of tests are held all the time: walking through them takes half a second, so rarely, as the command does.
gc.set_threshold(50_000, 20, 100)

# Neither does the terminal that the tests are run from: screens have the same colours and sizes everywhere.
for _name in (*VARIABLES, "FORCE_COLOR"):
    os.environ.pop(_name, None)

# An app parses all its style sheets, an eighth of what a test of screens takes: here each is parsed once in each theme.
_parse_rules, _parsed = Stylesheet._parse_rules, {}


def _parsed_once(sheet, *about, **more):
    key = (frozenset(sheet._variables.items()), *about, *sorted(more.items()))
    if key not in _parsed:
        _parsed[key] = _parse_rules(sheet, *about, **more)
    return _parsed[key]


Stylesheet._parse_rules = _parsed_once


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """``slow_but_first`` marks every case of a test but its first as slow."""
    begun = set()
    for item in items:
        if item.get_closest_marker("slow_but_first"):
            if (test := item.nodeid.partition("[")[0]) in begun:
                item.add_marker("slow")
            begun.add(test)


@pytest.fixture
def sender():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        yield sock


@pytest.fixture
def started(tmp_path):
    running = []

    def start(*urls, **options):
        ports = [free_port() for _ in range(not urls)]
        ingest = Ingest(urls or [f"udpin:{HOST}:{ports[0]}"], tmp_path / "telemetry.tlog", **options)
        running.append(ingest)
        return (ingest, ports[0]) if ports else ingest

    yield start
    for ingest in running:
        ingest.stop()
