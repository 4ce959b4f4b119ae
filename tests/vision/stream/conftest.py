"""Streams whose processes are as patient as a busy machine needs: it is slow, not wrong."""

import pytest

PATIENT = """
from vision.stream import exposure_times, reader
reader.BEHIND_S = exposure_times.LATE_S = 60.0
"""


@pytest.fixture(autouse=True)
def patient(tmp_path_factory, monkeypatch):
    """No frame is left undecoded, no time stamp out, and no recording unsealed because the machine is slow."""
    folder = tmp_path_factory.mktemp("python")
    (folder / "sitecustomize.py").write_text(PATIENT)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setattr("vision.stream.stream.CLOSE_S", 60.0)
