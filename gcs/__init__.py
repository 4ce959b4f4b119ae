"""The ground station: composes telemetry, vision and association; commands, sessions, screens."""
