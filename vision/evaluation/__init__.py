"""Quality of a detector on labelled images: average precision, precision and recall, headings, recall by size.

Boxes are rows ``cx cy w h angle`` of ``vision.detect.boxes``, pixels; headings clockwise from image up, rad, NaN
unknown. An object that does not *count* (difficult, mostly hidden, an unlabelled region) changes no figure, whether it
is found or not.
"""

from vision.evaluation.folder import Folder, open_folder, shard_truth
from vision.evaluation.matching import THRESHOLDS, Matches, match
from vision.evaluation.measures import Evaluation, evaluate
from vision.evaluation.precision import average_precision
from vision.evaluation.truth import Choice, LabelledImage, Truth, choose, choose_in_all

__all__ = [
    "THRESHOLDS",
    "Choice",
    "Evaluation",
    "Folder",
    "LabelledImage",
    "Matches",
    "Truth",
    "average_precision",
    "choose",
    "choose_in_all",
    "evaluate",
    "match",
    "open_folder",
    "shard_truth",
]
