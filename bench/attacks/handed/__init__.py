"""What strangers hand over: files that are opened, folders that lie among the recordings."""
