"""Relations of tracks to one another: track histories in, which were seen together, continued or exchanged out."""
