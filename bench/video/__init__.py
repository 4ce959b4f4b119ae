"""Live video, detectors and trackers: their speed, their losses, and parity with peers."""
