"""What knows neither MAVLink nor video: files that survive disks and crashes. Bytes and rows in, whole files out."""

import logging

# quiet until somebody asks for a log (infra.program_log)
logging.getLogger("infra").addHandler(logging.NullHandler())
