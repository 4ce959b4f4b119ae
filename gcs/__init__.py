"""The ground station: composes telemetry, vision and association; commands, sessions, screens."""

import logging

# quiet until a log is asked for (infra.program_log)
logging.getLogger("gcs").addHandler(logging.NullHandler())
