"""What finds vehicles in a picture, as the mission file chooses it.

By default one network finds boxes and their fronts; with ``[detector] front`` a second one tells the fronts of boxes
that come without, as a YOLO-OBB export's do.
"""

from __future__ import annotations

from pathlib import Path

from gcs.config import BUNDLED, DetectorChoice
from vision.detector import Detector, open_detector
from vision.front import FrontedDetector, open_front_classifier

__all__ = ["open_perception"]


def open_perception(choice: DetectorChoice) -> Detector:
    """Load the mission's networks.

    Raises:
        ModelError: a file is missing or is no such model.
    """
    detector = open_detector(Path(choice.model) if choice.model else None, score=choice.score)
    if not choice.front:
        return detector
    front = None if choice.front == BUNDLED else Path(choice.front)
    return FrontedDetector(detector, open_front_classifier(front, sure=choice.front_sure))
