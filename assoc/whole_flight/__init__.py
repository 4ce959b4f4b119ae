"""Names of a recording by all of its frames and reports at once."""
