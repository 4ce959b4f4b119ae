"""Names on map and video, read as an operator reads them: every one whole, by its id, or counted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.certainty import certainty
from gcs.playback.analysis import Analysis
from gcs.session.session import open_session
from gcs.snapshot import Box, VehicleRow
from gcs.tui.draw.ground_view import map_view_of, points_of
from gcs.tui.draw.map_canvas import chart_cells, map_labels
from gcs.tui.draw.video_canvas import video_cells, video_labels
from tests.support.bundled import CURVED_ROAD, SWARM
from tests.support.fake_station import make_snapshot
from tests.support.snapshots import misread

SIZES = ((60, 20), (80, 24), (120, 40), (160, 48), (41, 11))
EVERY = 10
"""Frames of a flight from one picture to the next."""
NAMES = ("Alpha", "Alpha", "Bravo-Charlie", "17", "UAV", "漢字", "e\u0301", "W" * 60, "", "?", "UGV-1", "Kilo?", "+3")


def names_of(snapshot):
    """All that may stand for each vehicle; a name that two have, or that reads like an id, stands for none."""
    names = [row.name for row in snapshot.vehicles]
    ids = {"UAV", "?", "", *(str(row.system_id) for row in snapshot.vehicles)}
    return {
        row.system_id: {"UAV", row.name}
        if row.role == "uav"
        else {
            str(row.system_id),
            *({row.name} - ids if names.count(row.name) == 1 and row.name.strip("?~+") == row.name else ()),
        }
        for row in snapshot.vehicles
    }


def on_map(snapshot, columns, rows, former=None, selected=0):
    view = map_view_of(points_of(snapshot), columns, rows - 1)
    labels = map_labels(snapshot, selected, view, former)
    said = [strip.text for strip in chart_cells(snapshot, selected, view, labels).strips()]
    assert len(said) == rows and {len(row) for row in said} == {columns}
    named, texts = names_of(snapshot), {}
    for row in snapshot.vehicles:
        x, y = view.dots(row.p_enu[None])[0]
        if 0 <= x < 2 * columns and 0 <= y < 4 * (rows - 1):
            state = "" if row.position_state == "ok" or row.role == "uav" else f" {row.position_state}"
            texts[row.system_id] = {name + state for name in named[row.system_id]}
    return said[:-1], texts, labels


def on_video(snapshot, columns, rows, former=None, selected=0):
    labels = video_labels(snapshot, selected, columns, rows, former=former)
    said = [strip.text for strip in video_cells(snapshot, selected, columns, rows, labelling=labels).strips()]
    assert {len(row) for row in said} == {columns}
    standing = {row.system_id: row.standing for row in snapshot.vehicles}
    named = names_of(snapshot)
    written = {place.key for place in labels.places}
    texts = {}
    for box in snapshot.boxes:
        inside = 0 <= box.cx < snapshot.width and 0 <= box.cy < snapshot.height
        if box.system_id and (inside or box.track_id in written):
            before = "~" if box.coasting else ""
            after = "?" if not box.coasting and standing[box.system_id] != "confirmed" else ""
            whole = {f"{before}{name}{after}" for name in named[box.system_id]}
            sure = f" {certainty(box.confidence)}"
            texts[box.system_id] = whole | {text + sure for text in whole}
    return [row.replace("no video", "        ") for row in said], texts, labels


def unnamed_counted(snapshot, labels):
    """Boxes without a name that are in a count."""
    written = sum(place.text in ("?", "~?") for place in labels.places)
    return sum(not box.system_id for box in snapshot.boxes) - written


def wrong_on(snapshot, size, former):
    """What is wrong on both pictures, and their labels for the next frame."""
    said, texts, on_ground = on_map(snapshot, *size, former and former[0])
    wrong = [f"map {size}: {each}" for each in misread(said, texts)]
    said, texts, in_image = on_video(snapshot, *size, former and former[1])
    said = [row.replace("~?", "  ") for row in said]
    texts |= {("unnamed", n): {f"unnamed {n}"} for n in range(unnamed_counted(snapshot, in_image))}
    edge = sum(not (0 <= box.cx < snapshot.width and 0 <= box.cy < snapshot.height) for box in snapshot.boxes)
    return wrong + [f"video {size}: {each}" for each in misread(said, texts, edge)], (on_ground, in_image)


def curved_road(tmp_path):
    """The recording with its true boxes: what a detector finds of them is not the matter here."""
    rows = [line.split(",") for line in (CURVED_ROAD / "truth.csv").read_text().splitlines()[1:]]
    for name in ("session.toml", "telemetry.tlog", "frames.csv"):
        (tmp_path / name).write_bytes((CURVED_ROAD / name).read_bytes())
    lines = ["frame,cx,cy,w,h,angle,score,heading", *(",".join([*row[:6], "0.9", ""]) for row in rows)]
    (tmp_path / "detections.csv").write_text("\n".join(lines))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("flight", ["curved-road", "swarm"])
def test_no_name_is_damaged_in_a_whole_flight(flight, tmp_path):
    analysis = Analysis(open_session(SWARM if flight == "swarm" else curved_road(tmp_path)))
    before = dict.fromkeys(SIZES)
    wrong, seen = [], 0
    for snapshot in analysis.snapshots(images=False):
        if snapshot.frame % EVERY:
            continue
        for size in SIZES:
            said, before[size] = wrong_on(snapshot, size, before[size])
            wrong += [f"frame {snapshot.frame} {each}" for each in said]
            seen += len(before[size][0].places)
    analysis.close()
    assert wrong == []
    assert seen > 1000


def clumps(seed, count=40, spread=4.0, names=None):
    """Vehicles in five heaps, boxes and places to match; some boxes without a name."""
    rng = np.random.default_rng(seed)
    heaps = rng.uniform(-40, 40, (5, 2))
    base = make_snapshot()
    rows, boxes = [base.vehicles[0]], []
    for n in range(count):
        system_id = n + 2
        place = heaps[n % 5] + rng.normal(0, spread, 2)
        standing = ("confirmed", "tentative", "coasting", "unidentified", "out of view")[n % 5 if seed % 2 else n // 8]
        named = standing in ("confirmed", "tentative", "coasting")
        sure = float(rng.uniform(0.3, 1.0))
        rows.append(
            VehicleRow(
                system_id=system_id,
                name=f"UGV-{system_id}" if names is None or n >= len(names) else names[n],
                role="ugv",
                standing=standing,
                position_state="stale" if n % 11 == 3 else "ok",
                p_enu=np.array([*place, 0.0]),
                heading=float(rng.uniform(0, 6)),
                std_m=1.0,
                confidence=sure if named else math.nan,
            )
        )
        at = {"cx": 640 + 12 * place[0], "cy": 360 - 7 * place[1], "w": 60.0, "h": 36.0, "angle": 0.4}
        if standing != "out of view":
            boxes.append(
                Box(
                    track_id=n + 1, heading=math.nan, score=0.9, coasting=standing == "coasting",
                    system_id=system_id if named else 0, confidence=sure, p_enu=np.array([*place, 0.0]), **at,
                )
            )  # fmt: skip
    return replace(base, vehicles=tuple(rows), boxes=tuple(boxes), image=None)


def moved(snapshot, step):
    """Some frames later: everybody a little elsewhere."""
    rng = np.random.default_rng(step)
    by = {row.system_id: rng.normal(0, 0.5, 3) for row in snapshot.vehicles}
    rows = [
        row if row.role == "uav" else replace(row, p_enu=row.p_enu + by[row.system_id]) for row in snapshot.vehicles
    ]
    boxes = [replace(each, cx=each.cx + 3.0 * step, cy=each.cy + rng.normal()) for each in snapshot.boxes]
    return replace(snapshot, vehicles=tuple(rows), boxes=tuple(boxes))


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.3, 3.0, 15.0])
@pytest.mark.parametrize("names", [None, NAMES], ids=["ids", "odd names"])
@pytest.mark.parametrize("seed", [1, 2])
def test_forty_vehicles_in_clumps_are_all_written_or_counted(seed, spread, names):
    for size in SIZES:
        former = None
        snapshot = clumps(seed, spread=spread, names=names)
        for step in range(4):
            said, former = wrong_on(snapshot, size, former)
            assert said == []
            snapshot = moved(snapshot, step)


@pytest.mark.parametrize("size", [(160, 48), (80, 24)])
def test_most_of_a_crowd_has_a_text_of_its_own(size):
    snapshot = clumps(1, spread=6.0)
    for labels in (on_map(snapshot, *size)[2], on_video(snapshot, *size)[2]):
        assert len(labels.places) >= 30


def test_the_picked_vehicle_has_its_whole_name():
    snapshot = clumps(2, spread=0.5)
    former = on_map(snapshot, 41, 11)[2]
    written = {place.key for place in former.places if place.form == 0}
    other = next(row.system_id for row in snapshot.vehicles[1:] if row.system_id not in written)
    for before in (None, former):
        labels = on_map(snapshot, 41, 11, before, other)[2]
        assert next(place for place in labels.places if place.key == other).text.startswith(f"UGV-{other}")


def test_labels_stay_where_they_are_while_they_can():
    """Everybody creeps by less than a cell: no label moves against its mark, but a few that get a better place."""
    snapshot = clumps(1, count=20, spread=10.0)
    former = on_map(snapshot, 120, 40)[2]
    moves = 0
    for step in range(10):
        rows = [replace(row, p_enu=row.p_enu + 0.02 * step) for row in snapshot.vehicles]
        labels = on_map(replace(snapshot, vehicles=tuple(rows)), 120, 40, former)[2]
        moves += sum(labels.former.get(key) != place for key, place in former.former.items())
        former = labels
    assert moves <= 10
    assert on_map(snapshot, 120, 40, former)[2] == on_map(snapshot, 120, 40, former)[2]


def test_a_short_id_is_explained_where_the_name_does_not_end_with_it():
    names = [f"Vehicle-{chr(ord('A') + n // 26)}{chr(ord('A') + n % 26)}" for n in range(40)]
    snapshot = clumps(1, spread=0.3, names=names)
    for pictured in (on_map, on_video):
        labels = pictured(snapshot, 50, 12)[2]
        short = {place.key for place in labels.places if names[0][:7] not in place.text and place.text[-1] != "?"}
        assert {place.key for place in labels.legend} <= short
        assert labels.legend
        assert {place.text for place in labels.legend} <= {f"{n + 2} = {name}" for n, name in enumerate(names)}


def test_a_label_away_from_its_mark_has_a_line_to_it():
    snapshot = clumps(2, spread=3.0)
    view = map_view_of(points_of(snapshot), 160, 47)
    labels = map_labels(snapshot, 0, view)
    away = [place for place in labels.places if place.leader]
    assert away
    said = [strip.text for strip in chart_cells(snapshot, 0, view, labels).strips()]
    seen = 0
    for place in away:
        left, top, width, height = place.rect
        around = [row[max(0, left - 2) : left + width + 2] for row in said[max(0, top - 1) : top + height + 1]]
        seen += any(0x2800 < ord(letter) <= 0x28FF for row in around for letter in row)
    # a line of one cell may lie under another label
    assert seen > 0.8 * len(away)
