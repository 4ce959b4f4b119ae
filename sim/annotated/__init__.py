"""Annotated films from public data sets under simulated telemetry: labels and the camera's motion in, an ordinary
session out."""
