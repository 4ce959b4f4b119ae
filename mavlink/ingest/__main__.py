"""``python -m mavlink.ingest PLAN``: the ingest process; only a station starts it."""

import sys

from mavlink.ingest.child import main
from mavlink.ingest.plan import Plan

if __name__ == "__main__":
    sys.exit(main(Plan.from_text(sys.argv[1])))
