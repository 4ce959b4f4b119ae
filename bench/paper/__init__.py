"""The published experiments on our own flights: their methods as written, our identifier on the very same frames.

Chen, Du, Wu, Drones 2025, 9(9), 612, doi:10.3390/drones9090612, section 4. ``python -m bench.paper``.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["run"]


def run(out: Path, quick: bool) -> None:
    """Measure everything and write tables, rows and figures, see :func:`bench.paper.suite.run`."""
    # the simulator and the trackers are loaded only by those who measure
    from bench.paper.suite import run as measure

    measure(out, quick)
