"""The command without what it needs to train."""

from __future__ import annotations

import pytest

from gcs.cli.detectors import train_detector as command
from gcs.errors import GcsError


def test_without_the_extra_it_tells_how_to_install_it(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    with pytest.raises(GcsError, match=r"needs torch and onnx: .*rollcall-gcs\[train\]"):
        command.train_detector(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
