"""The command line: one file per command; only here do errors become exit codes and one line on stderr."""
