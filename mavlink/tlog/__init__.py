"""Telemetry logs: packets in, a .tlog on disk, and back; damage found and reported by byte range."""
