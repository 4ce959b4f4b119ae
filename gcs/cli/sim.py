"""``gcs sim``: a simulated flight, as a session folder or live over the network."""
