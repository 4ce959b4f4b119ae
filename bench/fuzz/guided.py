"""Coverage-guided fuzzing with atheris, which is no dependency: install it beside the project to run these.

python -m bench.fuzz.atheris_datagram -max_total_time=120 NEW_INPUTS tests/corpus/datagram
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["guided"]


def guided(make: Callable[[], Callable[[bytes], None]], packages: list[str]) -> None:
    """Run one target until libFuzzer's own options end it.

    Args:
        make: imports what is fuzzed and returns the function that takes one input.
        packages: whose branches guide the search.
    """
    try:
        atheris: Any = import_module("atheris")
    except ImportError:
        raise SystemExit("atheris is not installed; pip install atheris") from None
    with atheris.instrument_imports(include=packages, enable_loader_override=False):
        target = make()
    atheris.Setup(sys.argv, target)
    atheris.Fuzz()
