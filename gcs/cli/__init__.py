"""The command line: one file per command; only here do errors become exit codes and one line on stderr."""

from gcs.cli.app import main

__all__ = ["main"]
