"""MAVLink in and out: links, telemetry logs, decoding, clocks, geodesy and the fleet's state.

SI units, radians, ENU metres, Unix µs. Degrees, millimetres and centimetres per second are converted on decoding.
"""

import logging

# quiet until a log is asked for (infra.program_log)
logging.getLogger("mavlink").addHandler(logging.NullHandler())
