"""Receiving, recording and reading telemetry: what it costs, and what floods, kills and disks do to it."""
