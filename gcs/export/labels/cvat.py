"""CVAT for images 1.1: ``images`` and ``annotations.xml``, boxes with their rotation.

As CVAT writes them: a box is given by the corners that it has before it is turned about its middle, ``rotation`` is in
degrees clockwise on screen, from 0 to below 360, and missing where it is 0.

Reference: https://docs.cvat.ai/docs/dataset_management/formats/format-cvat/.
"""

from __future__ import annotations

import math
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from gcs.export.job import ExportJob
from gcs.export.labels.frames import VEHICLE, LabelFolder, LabelledBox
from gcs.session.line_file import open_new
from gcs.snapshot import Snapshot
from infra.plain_text import plain

ATTRIBUTES: Final = ("track_id", "system_id", "name", "confidence", "score")
_ATTRIBUTE: Final = (
    "<attribute><name>{}</name><mutable>True</mutable><input_type>text</input_type>"
    "<default_value></default_value><values></values></attribute>"
)


class CvatExport:
    """Export to CVAT; attributes of a box say who it is, and CVAT's label needs attributes of these names to take them
    in."""

    def __init__(self, job: ExportJob) -> None:
        self._folder = LabelFolder(job)
        about = "".join(map(_ATTRIBUTE.format, ATTRIBUTES))
        label = f"<label><name>{VEHICLE}</name><attributes>{about}</attributes></label>"
        task = f"<task><name>{escape(plain(job.name))}</name><labels>{label}</labels></task>"
        head = f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n<meta>{task}</meta>\n'
        self._file = open_new(self._folder.path / "annotations.xml", head)
        self._images = 0

    def write(self, snapshot: Snapshot) -> bool:
        """Write a frame's image and labels, unless a box may be missing."""
        if (frame := self._folder.take(snapshot)) is None:
            return False
        size = f'width="{frame.width}" height="{frame.height}"'
        self._file.write(f'<image id="{self._images}" name={quoteattr(frame.image)} {size}>\n')
        self._file.writelines(map(_box, frame.boxes))
        self._file.write("</image>\n")
        self._images += 1
        return True

    def close(self) -> None:
        """Finish the labels."""
        self._file.write("</annotations>\n")
        self._file.close()
        self._folder.close()


def _box(one: LabelledBox) -> str:
    box = one.box
    sides = {"xtl": box.cx - box.w / 2, "ytl": box.cy - box.h / 2, "xbr": box.cx + box.w / 2, "ybr": box.cy + box.h / 2}
    place = " ".join(f'{key}="{px:.2f}"' for key, px in sides.items())
    rotation = round(math.degrees(box.angle), 2) % 360.0
    turned = f' rotation="{rotation:.2f}"' if rotation else ""
    attributes = "".join(
        f"<attribute name={quoteattr(key)}>{escape(str(value))}</attribute>" for key, value in one.attributes().items()
    )
    return f'<box label="{VEHICLE}" source="auto" occluded="0" {place}{turned} z_order="0">{attributes}</box>\n'
