"""Benchmarks: published experiments, field suite, latency, throughput; what was kept is in ``bench/results``."""
