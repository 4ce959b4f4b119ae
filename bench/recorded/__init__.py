"""Recorded sessions with truth: what the product makes of each, as a table.

python -m bench.recorded FOLDER [FOLDER ...] [--out bench-results/recorded]

A folder is a session, or holds sessions; those without truth are passed over.
"""
