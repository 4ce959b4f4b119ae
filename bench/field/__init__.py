"""The field suite: generated sessions with real errors, the product and others side by side, goals met or not.

python -m bench.field [--quick] [--seeds tune|report] [--family 9] [--out bench-results/field]
python -m bench.field --family 9 --hard --seed 3 --explain
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["run"]


def run(out: Path, quick: bool = False) -> None:
    """Play all families on the reporting seeds and write the tables, see :func:`bench.field.suite.run`."""
    # the simulator and the product are loaded only by those who measure
    from bench.field.suite import run as measure

    measure(out, quick)
