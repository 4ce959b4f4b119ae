"""Sockets and receiving processes that end with their test."""

import socket

import pytest

from bench.ports import free_port
from mavlink.ingest.ingest import Ingest
from tests.ingest_runs import HOST


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
