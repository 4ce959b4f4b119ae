"""Benchmarks: published experiments, field suite, latency, throughput; tables and figures in ``bench/results``."""
