"""Damage of every kind against readers that promise to lose nothing else: logs, datagrams, streams, others' files."""
