"""Detector that finds vehicles in an image, as the mission file chooses it.

By default one network finds boxes and their fronts; with ``[detector] front`` a second one finds the fronts of boxes
that come without, as a YOLO-OBB export's do.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from gcs.mission.mission import BUNDLED, DetectorChoice
from vision.detect.detector import BUNDLED as BUNDLED_BOXES
from vision.detect.detector import BUNDLED_PARTS, Detector, open_detector
from vision.detect.front import BUNDLED_FRONT, FrontedDetector, open_front_classifier
from vision.errors import ModelError
from vision.track.tracks import WEAK_SCORE


def open_mission_detector(choice: DetectorChoice, *, threads: int = 1) -> Detector:
    """Load the mission's networks; their boxes include weak ones, which the tracker alone makes use of.

    Args:
        choice: which.
        threads: CPU threads of one image: as many as there are cores where images are looked at one by one.

    Raises:
        ModelError: a file is missing or is no such model.
    """
    providers = choice.providers or None
    detector = open_detector(
        Path(choice.model) if choice.model else None,
        score=min(choice.score, WEAK_SCORE),
        classes=choice.classes or None,
        imgsz=choice.imgsz or None,
        tiled=choice.tiled,
        providers=providers,
        threads=threads,
    )
    if choice.front:
        front = None if choice.front == BUNDLED else Path(choice.front)
        classifier = open_front_classifier(front, sure=choice.front_sure, providers=providers, threads=threads)
        detector = FrontedDetector(detector, classifier, score=choice.score)
    return detector


def fingerprints(choice: DetectorChoice) -> dict[str, str]:
    """SHA-256 of the mission's networks by what they are for: ``boxes``, of the bundled one ``parts``, and ``front``.

    Raises:
        ModelError: a file cannot be read.
    """
    files = {"boxes": Path(choice.model)} if choice.model else {"boxes": BUNDLED_BOXES, "parts": BUNDLED_PARTS}
    if choice.front:
        files["front"] = BUNDLED_FRONT if choice.front == BUNDLED else Path(choice.front)
    return {name: _sha256(path) for name, path in files.items()}


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
