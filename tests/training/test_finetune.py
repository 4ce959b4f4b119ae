"""A fine-tuning run: interrupted and continued it ends as if it had not been, and its file is a detector like ours."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from gcs.cli.detectors.train_detector import train_detector
from training.split import split
from vision.detect.detector import BUNDLED, open_detector
from vision.errors import TrainingError
from vision.evaluation import open_folder

torch = pytest.importorskip("torch", reason="needs the extra 'train'")
pytest.importorskip("onnx", reason="needs the extra 'train'")

STEPS = 6


@pytest.fixture
def folder(tmp_path):
    """Six photographs from three places, with three cars each."""
    rng = np.random.default_rng(0)
    root = tmp_path / "labelled"
    for place in "abc":
        (root / place).mkdir(parents=True)
        for k in range(2):
            image = rng.integers(70, 90, (256, 320, 3)).astype(np.uint8)
            lines = []
            for x, y in zip((60.0, 160.0, 260.0), rng.uniform(40.0, 216.0, 3), strict=True):
                cv2.rectangle(image, (int(x) - 26, int(y) - 12), (int(x) + 26, int(y) + 12), (230, 230, 230), -1)
                lines.append(f"0 {x / 320:.5f} {y / 256:.5f} {52 / 320:.5f} {24 / 256:.5f}\n")
            cv2.imwrite(str(root / place / f"{k}.png"), image)
            (root / place / f"{k}.txt").write_text("".join(lines))
    return root


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr("training.train.BATCH", 2)
    monkeypatch.setattr("training.finetune.STATISTICS_IMAGES", 2)
    monkeypatch.setattr("training.finetune.MEASURED_STEPS", 2)
    monkeypatch.setattr("training.finetune.MIN_STEPS", STEPS)
    monkeypatch.setattr("training.finetune.LOSS_EVERY", 1)
    monkeypatch.setattr("training.finetune.CHECKS", 2)


def run_of(folder, out, *, resume=False, seed=0):
    from training.finetune import FineTuning, TrainingOptions

    kept = split(open_folder(folder).images, 0.3, 0)
    watched = split(kept.rest, 0.3, 0)
    return FineTuning(out, kept, watched, TrainingOptions(steps=STEPS, rendered=0.0, seed=seed), resume=resume)


def trained(run, until=None):
    """Train a run, to the end or until so many steps are done."""
    done = []
    run.mine(lambda done, total: None)
    whole = run.train(lambda step, steps: done.append(step), lambda: until is not None and done[-1] >= until)
    return whole, done


def test_an_interrupted_run_ends_as_if_it_had_not_been(folder, tmp_path):
    assert trained(run_of(folder, tmp_path / "whole")) == (True, [1, 2, 3, 4, 5, 6])
    assert trained(run_of(folder, tmp_path / "parts"), until=4) == (False, [1, 2, 3, 4])
    assert trained(run_of(folder, tmp_path / "parts", resume=True)) == (True, [5, 6])
    one, other = (torch.load(tmp_path / name / "checkpoint.pt", weights_only=True) for name in ("whole", "parts"))
    assert one["step_count"] == other["step_count"] == STEPS
    assert all(torch.equal(one["average"][name], other["average"][name]) for name in one["average"])
    for name in ("loss.csv", "quality.csv"):
        assert (tmp_path / "whole" / name).read_text() == (tmp_path / "parts" / name).read_text()


def test_rows_of_a_killed_run_come_once(folder, tmp_path):
    trained(run_of(folder, tmp_path / "out"), until=4)
    loss = tmp_path / "out" / "loss.csv"
    before = loss.read_text()
    with loss.open("a") as file:
        file.write("5" + ",1" * (before.splitlines()[0].count(",")) + "\n")
    trained(run_of(folder, tmp_path / "out", resume=True))
    assert [row.split(",")[0] for row in loss.read_text().splitlines()[1:]] == ["1", "2", "3", "4", "5", "6"]
    assert loss.read_text().startswith(before)


def test_a_run_is_continued_only_as_it_began(folder, tmp_path):
    out = tmp_path / "out"
    run_of(folder, out)
    with pytest.raises(TrainingError, match="exists already"):
        run_of(folder, out)
    with pytest.raises(TrainingError, match="other options"):
        run_of(folder, out, resume=True, seed=1)
    label = folder / "a" / "0.txt"
    label.write_text(label.read_text() + "0 0.5 0.5 0.1 0.1\n")
    with pytest.raises(TrainingError, match="other labels sha256"):
        run_of(folder, out, resume=True)
    (tmp_path / "file").write_text("")
    with pytest.raises(TrainingError, match="cannot be made"):
        run_of(folder, tmp_path / "file" / "out")
    with pytest.raises(TrainingError, match="no run to continue"):
        run_of(folder, tmp_path / "none", resume=True)


def test_weights_that_are_no_better_leave_the_bundled_file_as_it_is(folder, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run = run_of(folder, out)
    trained(run, until=1)
    monkeypatch.setattr("training.finetune.FineTuning._best", lambda self: 0)
    run.finish()
    assert run.best_step == 0
    assert (out / "model.onnx").read_bytes() == BUNDLED.read_bytes()
    assert json.loads((out / "run.json").read_text())["score returned as 0.3"] == 0.3


def test_the_command_writes_a_detector_and_compares_it(folder, tmp_path, capsys):
    out = tmp_path / "out"
    options = {"minutes": 60.0, "steps": STEPS, "rendered": 0.0, "seed": 0, "gsd": 0.0865, "form": None}
    options |= {"classes": None, "ignore": None, "names": None, "corners_tell_front": False}
    train_detector(folder, out, resume=False, **options)
    told = capsys.readouterr()
    assert "AP50 of centres" in told.out
    assert "recall of this" in told.out
    assert "are kept apart to measure: whole folders" in told.err
    image = open_folder(folder).images[0]
    found = open_detector(out / "model.onnx", score=0.1).detect(image.read(), gsd_m=0.0865)
    apart_px = np.linalg.norm(found.centre[:, None] - image.truth.boxes[:, :2], axis=2)
    assert (apart_px.min(axis=0) < 8.0).all()
    record = json.loads((out / "run.json").read_text())
    assert record["options"]["steps"] == STEPS
    assert record["measured"]["objects"] == record["measured"]["comparison"]["other"]["objects"] == 6
    assert {"curves.png", "loss.csv", "quality.csv"} <= {path.name for path in out.iterdir()}
    written = (out / "model.onnx").read_bytes()
    train_detector(folder, out, resume=True, **options)
    assert (out / "model.onnx").read_bytes() == written
    assert "AP50" in capsys.readouterr().out
