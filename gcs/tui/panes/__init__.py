"""The panes: a snapshot in, rows on the screen out."""
