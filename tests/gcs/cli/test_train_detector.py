"""The command without what it needs to train."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.cli.detectors import train_detector as command
from gcs.errors import GcsError


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("find_spec", lambda name: None, r"needs torch and onnx: in the checkout, .*\[train\]"),
        ("CHECKOUT", Path("/nowhere"), r"needs a checkout of Rollcall, .*\[train\]"),
    ],
)
def test_without_what_it_needs_it_tells_how_to_get_it(name, value, says, monkeypatch, tmp_path):
    monkeypatch.setattr(command, name, value)
    with pytest.raises(GcsError, match=says):
        command.train_detector(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
