"""Checks of imported logs: times against times, positions against their path, numbers against other sources."""
