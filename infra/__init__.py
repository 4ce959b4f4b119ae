"""Files that survive disks and crashes, and all else below MAVLink and video. Bytes and rows in, whole files out."""

import logging

# quiet until a log is asked for (infra.program_log)
logging.getLogger("infra").addHandler(logging.NullHandler())
