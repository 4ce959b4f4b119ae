"""How tracks relate to one another: track histories in, who was seen together, handed over or exchanged out."""
