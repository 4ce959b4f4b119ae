"""The screens behind a slow line: how soon a key shows, and what a terminal that is gone costs."""
