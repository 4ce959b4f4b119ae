"""Camera motion from the pixels of rendered flights: how exact it is, what it costs, what it is worth for names."""
