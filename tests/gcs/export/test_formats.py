"""The list of formats, and its table in the documents."""

import gc
import re
import resource
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import SessionError
from gcs.export.formats import FORMATS
from gcs.export.job import ExportJob
from gcs.export.unfinished import writing_to
from infra.files.disk import OF_THE_DISK
from tests.support.command_line import run_gcs


def test_the_document_has_the_list():
    table = Path("docs/export.md").read_text(encoding="utf-8").partition("## All formats")[2].partition("##")[0]
    rows = [line.split(" | ")[:5] for line in table.splitlines() if line.startswith("| `")]
    told = {row[0].strip("| `"): [cell.strip(" `|") for cell in row[1:]] for row in rows}
    assert told == {
        form.name: [form.suffix or "folder", form.contents, form.opened_by, form.extra] for form in FORMATS.values()
    }


def test_the_list_names_each_format():
    code, told, _ = run_gcs("export", "--list")
    assert code == 0
    assert set(re.findall(r"^ *│? *([a-z0-9]+) ", told, re.MULTILINE)) >= set(FORMATS)


def test_no_two_formats_have_one_ending():
    endings = [form.suffix for form in FORMATS.values() if form.suffix]
    assert len(endings) == len(set(endings))


@pytest.mark.slow_but_first
@pytest.mark.filterwarnings("ignore")  # what breaks off closes nothing
@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_an_export_that_breaks_off_leaves_nothing(form, shots, flight, tmp_path):
    times_us = np.array([one.t_us for one in shots])
    job = ExportJob(path=tmp_path / f"out{form.suffix}", name="a", video=flight / "video.mp4", times_us=times_us)
    sink = form.open(job)
    for one in shots[:2]:
        sink.write(replace(one, image=np.zeros((1080, 1920, 3), np.uint8)))
    assert not job.path.exists()
    del sink
    gc.collect()
    assert list(tmp_path.iterdir()) == []
    job.path.write_text("there before")
    with pytest.raises(SessionError, match="exists already"):
        form.open(job)
    assert job.path.read_text() == "there before"


@pytest.fixture
def small_disk(monkeypatch):
    """No file gets longer than some hundred bytes."""
    # Python 3.11 keeps a compiled module that was cut short, and fails at every later import of it
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.slow_but_first
@pytest.mark.filterwarnings("ignore")  # what breaks off closes nothing
@pytest.mark.parametrize("form", FORMATS.values(), ids=FORMATS)
def test_a_full_disk_is_told_with_the_place_that_is_written_to(form, shots, flight, tmp_path, small_disk):
    times_us = np.array([one.t_us for one in shots])
    job = ExportJob(path=tmp_path / f"out{form.suffix}", name="a", video=flight / "video.mp4", times_us=times_us)
    with pytest.raises(OSError, match="out") as caught, writing_to(job.path):
        sink = form.open(job)
        for one in shots:
            sink.write(replace(one, image=np.zeros((1080, 1920, 3), np.uint8)))
        sink.close()
    assert caught.value.filename == str(job.path) and caught.value.errno in OF_THE_DISK
    del caught
    gc.collect()
    assert not job.path.exists()
