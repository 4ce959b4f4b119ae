"""The screens measured: whether what they show is true, how soon a key shows, and what they cost."""
