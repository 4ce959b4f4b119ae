"""Recorded sessions with truth: what the product makes of each, as a table, beside an earlier one if asked.

python -m bench.recorded FOLDER [FOLDER ...] [--before recorded.csv] [--out bench-results/recorded]

A folder is a session, or holds sessions; those without truth are passed over.
"""
