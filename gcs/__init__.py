"""The ground station: composes telemetry, vision and association; commands, sessions, screens."""

import logging

# quiet until somebody asks for a log (infra.program_log)
logging.getLogger("gcs").addHandler(logging.NullHandler())
