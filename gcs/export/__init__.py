"""Identity logs in forms that other people's tools read: one file per format, all fed with snapshots."""
