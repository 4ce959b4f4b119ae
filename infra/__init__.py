"""What knows neither MAVLink nor video: files that survive disks and crashes. Bytes and rows in, whole files out."""

import logging

# quiet until a log is asked for (infra.program_log)
logging.getLogger("infra").addHandler(logging.NullHandler())
