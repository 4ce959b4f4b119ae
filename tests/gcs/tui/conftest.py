"""Every test of the screens begins in the default theme, and a busy machine is not a silent flight."""

import pytest

from gcs.tui import RollcallApp
from gcs.tui.palette import use_theme


@pytest.fixture(autouse=True)
def _default_theme():
    use_theme("dark")


@pytest.fixture(autouse=True)
def _patient(monkeypatch):
    """A flight that never changes is not yet silent for as long as a test takes."""
    monkeypatch.setattr(RollcallApp, "silent_after_s", 600.0)
