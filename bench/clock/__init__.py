"""How well a fleet's clock is found in films of a minute: share found, refused and wrong, over simulated flights."""
