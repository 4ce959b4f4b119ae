"""How long each method takes, beside its literal peer in the same run. ``python -m bench.latency``."""
