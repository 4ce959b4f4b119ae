"""From video to tracks: frames, camera geometry, oriented detection, tracking.

Pixels (x right, y down, from the image's edge), radians, ENU metres, Unix µs (``t_us``). Box angle: image +x to the
width axis, clockwise on screen; image heading: clockwise from image up. Camera frame: x right, y down, z forward.
"""

import logging
import os

# By default onnxruntime stores a machine id in the user's home and sends telemetry to its maker.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# quiet until a log is asked for (infra.program_log)
logging.getLogger("vision").addHandler(logging.NullHandler())
