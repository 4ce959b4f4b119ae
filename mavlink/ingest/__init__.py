"""Telemetry ingest in a process of its own: links, record, signatures and forwarding, handed over in shared memory.

The station uses :class:`mavlink.ingest.ingest.Ingest`; ``python -m mavlink.ingest`` is the process.
"""
