"""Benchmarks: the published experiments, the field suite, latency, throughput; tables and figures in ``bench/results``."""
