"""Flights with faults, recorded and identified again: whether both give every box the same name."""
