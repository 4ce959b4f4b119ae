"""A simulated flight: world, traffic, telemetry with errors, camera, renderer, truth.

Independent of the code it tests. ENU metres; angles in radians, headings clockwise from north; times in seconds since
the first frame, or Unix microseconds where the name ends in _us.
"""
