"""Attacks on a running ``gcs fly``, run from outside, with what was recorded and accepted of each."""
