"""Flights that others recorded: videos, subtitles, logs and tables in, an ordinary session folder out.

Each format is read into a ``VehicleLog``; the logs become MAVLink on one time line, beside the untouched video.
"""
