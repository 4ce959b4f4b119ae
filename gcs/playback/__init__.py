"""A recorded flight: a session or a log in, the same snapshots at any place and speed out."""
