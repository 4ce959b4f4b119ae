"""The only place where telemetry, vision and association meet: packets and frames in, one Snapshot a frame out."""
