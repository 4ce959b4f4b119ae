"""Attacks on a running ``gcs fly``, played from outside, with what was recorded and believed of each."""
