"""``gcs export``, ``gcs report``, ``gcs score``: what became of a recording, for other programs and for people."""
