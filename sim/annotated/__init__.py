"""Annotated films of others under simulated telemetry: labels and the camera's motion in, an ordinary session out."""
