"""MAVLink in and out: links, telemetry logs, decoding, clocks, geodesy and the fleet's state.

SI units, radians, ENU metres, Unix µs. Degrees, millimetres and centimetres per second are converted on decoding.
"""
