"""Printing for the command line: tables, JSON, one progress bar, and errors in one line; results in, lines out."""
