"""Foxglove's channels of what is known of a frame besides its picture: for files and for live viewers alike."""

from __future__ import annotations

import json
from typing import Final

import foxglove
from foxglove import channels
from foxglove.messages import Log, LogLevel

from gcs.export.robotics.foxglove_views import annotations_of, fix_of, scene_of, stamp_of
from gcs.session.box_table import json_row
from gcs.snapshot import Snapshot
from infra.plain_text import plain
from mavlink.state import Level

LEVELS: Final = {"info": LogLevel.Info, "warning": LogLevel.Warning, "alarm": LogLevel.Error}
IDENTITY_SCHEMA: Final = {
    "type": "object",
    "title": "rollcall.Identity",
    "properties": {
        "time_us": {"type": "integer"},
        "frame": {"type": "integer"},
        "boxes": {"type": "array", "items": {"type": "object"}},
    },
}


class FoxgloveChannels:
    """Foxglove channels but those of the video; ``gcs.export.robotics.mcap`` lists them."""

    def __init__(self, context: foxglove.Context) -> None:
        self._context = context
        self._annotations = channels.ImageAnnotationsChannel("/camera/annotations", context=context)
        self._scene = channels.SceneUpdateChannel("/scene", context=context)
        self._log = channels.LogChannel("/log", context=context)
        self._identity = foxglove.Channel("/identity", schema=IDENTITY_SCHEMA, context=context)
        self._fixes: dict[int, channels.LocationFixChannel] = {}
        self._in_scene: frozenset[str] = frozenset()

    def write(self, snapshot: Snapshot) -> None:
        """Send a frame's boxes, and where vehicles report to be."""
        t_ns = 1000 * snapshot.t_us
        boxes = [box for box in snapshot.new_boxes if not box.coasting]
        if not snapshot.held:
            self._annotations.log(annotations_of(snapshot, boxes), log_time=t_ns)
            update, self._in_scene = scene_of(snapshot, boxes, self._in_scene)
            self._scene.log(update, log_time=t_ns)
            rows = [json.loads(json_row(snapshot, box)) for box in boxes]
            self._identity.log({"time_us": snapshot.t_us, "frame": snapshot.frame, "boxes": rows}, log_time=t_ns)
        for row in snapshot.vehicles:
            fix = fix_of(snapshot, row)
            if fix is not None:
                topic = f"/vehicles/{row.system_id}/fix"
                if row.system_id not in self._fixes:
                    self._fixes[row.system_id] = channels.LocationFixChannel(topic, context=self._context)
                self._fixes[row.system_id].log(fix, log_time=t_ns)

    def write_words(self, at_us: int, t_us: int, level: Level, kind: str, text: str) -> None:
        """Send a line of the log."""
        message = Log(timestamp=stamp_of(at_us), level=LEVELS[level], name=kind, message=plain(text))
        self._log.log(message, log_time=1000 * t_us)
