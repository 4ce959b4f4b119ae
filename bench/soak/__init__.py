"""A simulated flight of hours: what is lost, how late it is, and whether anything grows."""
