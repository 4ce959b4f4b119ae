"""Sessions on disk: snapshots, packets and events in, a folder out; a folder in, its tables out."""
