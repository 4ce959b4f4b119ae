"""Health: what is wrong now: snapshots in, alarms and events out."""
