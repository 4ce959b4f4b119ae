"""``python -m mavlink.ingest``: the ingest process; only a station starts it."""

import sys

from mavlink.ingest.worker import main

if __name__ == "__main__":
    sys.exit(main())
