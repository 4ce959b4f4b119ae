"""The video pane: the frame in half blocks, or real pixels where the terminal can show them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.reactive import reactive
from textual.strip import Strip

from gcs.health.station_alarms import LATE_S
from gcs.report.inset import Inset
from gcs.report.labels import Labelling
from gcs.report.overlay import draw, image_inset, image_labels
from gcs.snapshot import HELD_SHOWN_S, Snapshot
from gcs.station import CameraPicture
from gcs.tui.draw.format import age
from gcs.tui.draw.mosaic import HALF_BLOCKS, PictureMode
from gcs.tui.draw.pixels import Pixels
from gcs.tui.draw.strips import Part, line, width_of
from gcs.tui.draw.video_canvas import box_at, video_cells, video_inset, video_labels
from gcs.tui.framing import PictureRegion, frame_for, framed
from gcs.tui.messages import VehiclePicked
from gcs.tui.palette import ALARM, FAINT, HEAD, INK, WARN, ink
from gcs.tui.panes.pane import Pane
from gcs.tui.tiles import tile_at, tiled_cells
from infra.plain_text import plain

PIXELS_EVERY_S = 0.15
"""Least time between images; a terminal that takes longer is given as long again to answer keys."""
LAG_SHOWN_S = 0.05
IMAGE_ID = "pixels"
MIN_RULE = 4
"""Cells round the pane's name, and of the line between it and the figures."""


def _apart(parts: Sequence[Part], room: int) -> list[Part]:
    """Figures that fit, with a dot between them: of a number alone nobody knows which word it belongs to."""
    faint = ink(FAINT, HEAD)
    for count in range(len(parts), 0, -1):
        for dot in (" · ", "·"):
            spaced = [each for part in parts[:count] for each in ((dot, faint), part)][1:]
            if width_of(spaced) < room:
                return [*spaced, (" ", faint)]
    return []


def _state_parts(snapshot: Snapshot) -> list[Part]:
    """State of the video where that is not good, else its figures, the most needed first."""
    health, lag = snapshot.health, f"lag {snapshot.health.lag_s:.1f}s"
    old = snapshot.frame_age_s > HELD_SHOWN_S
    good = health.video == "ok" and not old
    if old and health.video in ("ok", "stalled"):
        state, colour = f"{age(snapshot.frame_age_s)} old", WARN if health.video == "ok" else ALARM
    else:
        state, colour = plain(health.video), {"waiting": FAINT, "ended": INK}.get(health.video, ALARM)
    figures = (
        (not good and health.video != "none", state, colour),
        (good and health.undecoded > 0, f"{health.undecoded} undecoded", WARN),
        (good and health.lag_s > LATE_S, lag, WARN),
        (good and health.fps > 0, f"{health.fps:.0f} fps", FAINT),
        (snapshot.frame >= 0, f"frame {snapshot.frame}", FAINT),
        (good and health.looked_share < 1.0, f"{health.looked_share:.0%} looked at", FAINT),
        (good and LAG_SHOWN_S <= health.lag_s <= LATE_S, lag, FAINT),
    )
    return [(text, ink(colour, HEAD)) for known, text, colour in figures if known]


class VideoPane(Pane):
    """The frame with boxes and names."""

    label: ClassVar[str] = "VIDEO"
    is_picture: ClassVar[bool] = True
    enlarged: reactive[bool] = reactive(False, repaint=False)
    """True if the picked vehicle is shown enlarged in a corner."""
    tiles: reactive[tuple[CameraPicture, ...]] = reactive((), repaint=False)
    """Pictures of all cameras beside each other, in place of that on show; none: it alone."""

    def __init__(self, *, id: str, pixels: Pixels | None = None, mode: PictureMode = HALF_BLOCKS) -> None:
        super().__init__(id=id)
        self._mode = mode
        self._pixels = pixels
        self._rest_until = 0.0
        self._look: tuple[int, ...] = ()
        self._late = False
        self._frame: PictureRegion | None = None
        self._shown: Snapshot | None = None
        """Snapshot that is on screen in cells: as if the image were the part that is shown."""
        self._labelling = Labelling()
        self._inset: Inset | None = None
        self._tile_labels: dict[int, Labelling] = {}

    def compose(self) -> ComposeResult:
        """An image of textual-image in pixel mode, nothing else."""
        if self._pixels is not None:
            yield self._pixels.widget(id=IMAGE_ID)

    def note(self) -> Sequence[Part]:
        """State of the video, rate, lag and frame number."""
        if self.snapshot is None:
            return ()
        if self.enlarged and not (self._inset and self._inset.seen):
            return [(self._inset_note(), ink(WARN, HEAD))]
        parts = [*self._frame_parts(self.snapshot), *_state_parts(self.snapshot)]
        return _apart(parts, self.size.width - len(self.label) - MIN_RULE)

    def _frame_parts(self, snapshot: Snapshot) -> list[Part]:
        """Words for the magnification of the part on show, and for the number of boxes beyond it."""
        if self._frame is None or self._shown is None or self._frame.rect[2] >= snapshot.width:
            return []
        beyond = len(snapshot.boxes) - len(self._shown.boxes)
        words = [f"zoom {snapshot.width / self._frame.rect[2]:.1f}", *[f"{beyond} beyond"] * (beyond > 0)]
        return [(each, ink(INK, HEAD)) for each in words]

    def _inset_note(self) -> str:
        """Return why the picked vehicle is not seen enlarged."""
        if self._inset is not None:
            return "Z: where it should be "
        return "Z: not in the picture " if self.selected or self.picked_track else "Z: pick a vehicle "

    def body(self, width: int, height: int) -> list[Strip]:
        """Draw the frame, or a word on what is awaited."""
        if self.snapshot is None:
            return [line([(" waiting for the first frame …", ink(FAINT))], width)]
        if height <= 0:
            return []
        if self.tiles:
            return self._tiled(width, height)
        if self._pixels is not None:
            self._send(self._pixels, self.snapshot, width, height)
            return []
        shown = self._shown = self._framed(self.snapshot, width / (2 * height))
        field = shown, self.selected, width, height, self.picked_track
        inset = self._inset = video_inset(*field, self._inset) if self.enlarged else None
        self._labelling = video_labels(*field, self._labelling, inset)
        return video_cells(*field, self._labelling, self._mode, inset).strips()

    def _tiled(self, width: int, height: int) -> list[Strip]:
        """Draw all cameras in cells, whatever the terminal can show: a small picture has no more to see in pixels."""
        self._shown = self._frame = self._inset = None
        field = self.tiles, self.selected, width, height, self.picked_track
        cells, self._tile_labels = tiled_cells(*field, self._tile_labels, self._mode)
        return cells.strips()

    def _framed(self, snapshot: Snapshot, shape: float) -> Snapshot:
        """The part that is shown; all of it on the whole screen, which has room for it."""
        if snapshot.image is None or snapshot.width <= 0 or snapshot.height <= 0 or self.maximised:
            self._frame = None
            return snapshot
        self._frame = frame_for(snapshot, (self.selected, self.picked_track), shape, self._frame)
        return framed(snapshot, self._frame)

    def _send(self, pixels: Pixels, snapshot: Snapshot, width: int, height: int) -> None:
        now = time.monotonic()
        look = (width, height, self.selected, self.picked_track, self.enlarged)
        if look == self._look and now < self._rest_until:
            self._catch_up(self._rest_until - now)
            return
        self._look, self._rest_until = look, now + PIXELS_EVERY_S
        wide, high = max(1, snapshot.width), max(1, snapshot.height)
        scale = min(width * pixels.cell_width / wide, height * pixels.cell_height / high)
        child = self.query_one(f"#{IMAGE_ID}")
        child.styles.width = max(1, min(width, int(wide * scale / pixels.cell_width)))
        child.styles.height = max(1, min(height, int(high * scale / pixels.cell_height)))
        child.styles.margin = (1, 0, 0, 0)
        selected, track = self.selected, self.picked_track
        inset = None
        if self.enlarged:
            inset = image_inset(snapshot, scale=scale, selected=selected, track=track, former=self._inset)
        self._inset = inset
        self._labelling = image_labels(
            snapshot, scale=scale, selected=selected, track=track, former=self._labelling, inset=inset
        )
        image = draw(snapshot, scale=scale, selected=selected, track=track, labelling=self._labelling, inset=inset)
        child.image = pixels.to_widget(image)  # type: ignore[attr-defined]
        self.call_after_refresh(self._rest, now)

    def watch_enlarged(self) -> None:
        """Show the inset, or take it away."""
        self.redraw()

    def watch_tiles(self, before: tuple[CameraPicture, ...], tiles: tuple[CameraPicture, ...]) -> None:
        """Hide the picture while there are tiles, and draw again, when another camera has a new picture or tiles come
        or go."""
        if self._pixels is not None and bool(before) != bool(tiles):
            self.query_one(f"#{IMAGE_ID}").display = not tiles
            self._look = ()
        self.redraw()

    def _is_on_inset(self, x: int, y: int) -> bool:
        if self._inset is None or self._pixels is not None:
            return False
        left, top, width, height = self._inset.rect
        return left <= x < left + width and top <= y < top + height

    def _rest(self, began: float) -> None:
        now = time.monotonic()
        self._rest_until = now + max(PIXELS_EVERY_S, now - began)

    def _catch_up(self, wait_s: float) -> None:
        """The newest frame comes once the rest is over, even if no newer one follows."""
        if not self._late:
            self._late = True
            self.set_timer(wait_s + 0.01, self._catch_up_now)

    def _catch_up_now(self) -> None:
        self._late = False
        self.redraw()

    def on_click(self, event: events.Click) -> None:
        """Pick the vehicle or the box under the pointer; in the picture of a camera that is not on show a vehicle."""
        if self.tiles:
            width, height = self.size.width, self.size.height - 1
            found = tile_at(self.tiles, event.x, event.y - 1, width, height)
            if found is not None and found[0].snapshot is not None:
                tile, (left, top, width, height) = found
                box = box_at(found[0].snapshot, event.x - left, event.y - 1 - top, width, height)
                track = box.track_id if box and tile.on_show else 0
                self.post_message(VehiclePicked(box.system_id, track) if box else VehiclePicked(0))
            return
        shown = self.snapshot if self._pixels is not None else self._shown
        if shown is not None and not self._is_on_inset(event.x, event.y - 1):
            box = box_at(shown, event.x, event.y - 1, self.size.width, self.size.height - 1)
            self.post_message(VehiclePicked(box.system_id, box.track_id) if box else VehiclePicked(0))
