"""Receiving, recording and reading telemetry: what it costs, and what floods do to it."""
