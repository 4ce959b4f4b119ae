"""Child processes that are replaced when they die or hang: a module's name comes in, messages both ways come out."""
