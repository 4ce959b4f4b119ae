"""A recording that is exported again and again."""

import csv

import numpy as np
import pytest

from gcs.export.formats import format_for
from gcs.export.job import ExportJob
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from tests.support.bundled import CURVED_ROAD, shortened


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """Forty frames of a film with its telemetry; boxes are those of the truth, since the detector takes longer."""
    folder = shortened(CURVED_ROAD, tmp_path_factory.mktemp("exported") / "flight", 40)
    with (folder / "truth.csv").open() as file:
        rows = [(*list(row.values())[:6], "0.9000", "") for row in csv.DictReader(file)]
    lines = ["frame,cx,cy,w,h,angle,score,heading", *(",".join(row) for row in rows)]
    (folder / "detections.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="session")
def shots(flight):
    """Its snapshots."""
    analysis = Analysis(open_session(flight))
    found = list(analysis.snapshots(images=False))
    analysis.close()
    return found


@pytest.fixture(scope="session")
def export_to(flight, shots):
    """What writes the recording to a path, as the command does but for folding it anew."""

    def write(path):
        times_us = np.array([shot.t_us for shot in shots])
        job = ExportJob(path=path, name="flight", video=flight / "video.mp4", times_us=times_us)
        sink = format_for(path).open(job)
        for shot in shots:
            sink.write(shot)
        sink.close()
        return path

    return write
