"""Where the tests find what the repository holds."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
"""The repository's root."""
