"""Every test of the screens begins in the default theme, whatever the one before it has left."""

import pytest

from gcs.tui.palette import use_theme


@pytest.fixture(autouse=True)
def _default_theme():
    use_theme("dark")
