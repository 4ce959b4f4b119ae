from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from sim.render.ground import GroundStyle
from sim.render.render import Renderer, Style
from sim.world.boxes import true_boxes
from sim.world.view import OCCLUDER, OTHER_VEHICLE, PERSON, UGV, Bodies, CameraView, Road, Scene
from tests.support.onnx_models import UINT8, model
from training.quality import measure
from vision.detect import decode_heatmap
from vision.detect.boxes import wrap
from vision.detect.detections import Detections
from vision.detect.detector import BUNDLED, HeatmapDetector, open_detector
from vision.detect.tiles import tile_grid
from vision.errors import ModelError


def camera(height=40.0, size=(1280, 720), focal=1200.0, xy=(0.0, 0.0)):
    R_enu_cam = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    return CameraView(
        width=size[0],
        height=size[1],
        fx=focal,
        fy=focal,
        cx=size[0] / 2,
        cy=size[1] / 2,
        distortion=np.zeros(5),
        R_enu_cam=R_enu_cam,
        p_enu=np.array([*xy, height]),
    )


SIZE = {UGV: (2.2, 1.4, 0.9), OTHER_VEHICLE: (4.5, 1.8, 1.5), PERSON: (0.5, 0.5, 1.75), OCCLUDER: (4.0, 4.0, 6.0)}


def bodies(*rows, colors=((60, 140, 60),)):
    kind, x, y, heading = np.array(rows, dtype=float).reshape(-1, 4).T
    length, width, height = np.array([SIZE[int(k)] for k in kind]).reshape(-1, 3).T
    color = np.array([colors[i % len(colors)] for i in range(len(kind))], np.uint8).reshape(-1, 3)
    return Bodies(
        kind=kind.astype(np.int8), x=x, y=y, heading=heading, length=length, width=width, height=height, color=color
    )


def truth(view, things):
    boxes = true_boxes(view, things)
    weight = np.ones(len(boxes.cx))
    rows = np.stack([boxes.cx, boxes.cy, boxes.w, boxes.h, boxes.angle + np.pi / 2, weight], axis=1)
    return rows[np.isin(things.kind, (UGV, OTHER_VEHICLE))]


@pytest.fixture(scope="module")
def renderer():
    line = np.stack([np.linspace(-60, 60, 121), 4.0 * np.sin(np.linspace(-60, 60, 121) / 15)], axis=1)
    return Renderer(
        Scene(roads=(Road(centre=line, width=9.0, lanes=3),)), Style(ground=GroundStyle(side_px=2048)), seed=77
    )


@pytest.fixture(scope="module")
def detector():
    return open_detector()


def team(seed, n=9):
    """Vehicles of two kinds on a jittered grid, any heading, persons and trees between them."""
    rng = np.random.default_rng(seed)
    cells = [(x, y) for x in (-16, -9, -2, 5, 12) for y in (-8, 0, 8)]
    rows = []
    for i, c in enumerate(rng.permutation(len(cells))):
        x, y = np.array(cells[c]) + rng.uniform(-1, 1, 2)
        rows.append((UGV if i < n - 2 else OTHER_VEHICLE if i < n else PERSON, x, y, rng.uniform(0, 2 * np.pi)))
    return bodies(*rows, colors=((60, 140, 60),) if seed % 2 else ((40, 60, 190), (150, 150, 150)))


def test_bundled_model_finds_rendered_vehicles_and_their_fronts(renderer, detector):
    found, real = [], []
    for seed in range(6):
        things, view = team(seed), camera()
        image = renderer.draw(view, things, seed)
        found.append(detector.detect(image, gsd_m=40.0 / 1200.0))
        real.append(truth(view, things))
    quality = measure(found, real)
    assert quality.recall >= 0.97
    assert quality.precision >= 0.97
    assert quality.flips <= 0.02
    assert quality.unsure <= 0.02
    assert quality.heading_deg <= 4.0
    assert quality.centre_px <= 3.0
    for d in found:  # a known front: the width axis points to it
        np.testing.assert_allclose(wrap(d.heading - d.angle - np.pi / 2), 0.0, atol=1e-9)


def test_parts_show_what_the_whole_picture_shows(renderer, detector):
    view, things = camera(120.0), team(0)
    parts = tile_grid((1280, 720), (320, 320), 96)
    seen = detector.detect_in(renderer.draw(view, things, 0), parts, gsd_m=120.0 / 1200.0)
    quality = measure([seen], [truth(view, things)])
    assert quality.recall >= 0.97 and quality.precision >= 0.97 and quality.centre_px <= 2.0


def test_persons_trees_and_bare_road_are_no_vehicles(renderer, detector):
    things = bodies(*[(PERSON, x, 3.0, x) for x in range(-12, 12, 3)], (OCCLUDER, 0, -6, 0), (OCCLUDER, 8, -6, 0))
    for view in (camera(), camera(xy=(20.0, 3.0))):
        assert len(detector.detect(renderer.draw(view, things), gsd_m=40.0 / 1200.0)) == 0


@pytest.mark.slow_but_first
@pytest.mark.parametrize("height", [15.0, 25.0, 70.0, 110.0])
def test_ground_resolution_brings_vehicles_to_the_length_that_the_model_knows(renderer, detector, height):
    view = camera(height, size=(1280, 720))
    things = bodies((UGV, -2.0, 1.0, 0.5), (UGV, 2.5, -1.5, 2.5), (UGV, 3.5, 2.0, 4.0))
    quality = measure([detector.detect(renderer.draw(view, things), gsd_m=height / 1200.0)], [truth(view, things)])
    assert quality.recall == quality.precision == 1.0
    assert quality.flips == 0.0


@pytest.mark.slow_but_first
@pytest.mark.parametrize("gsd_m", [None, np.nan, 0.0])
def test_unknown_ground_resolution_still_finds(renderer, detector, gsd_m):
    view, things = camera(), team(1)
    quality = measure([detector.detect(renderer.draw(view, things), gsd_m=gsd_m)], [truth(view, things)])
    assert quality.recall >= 0.9


@pytest.mark.slow_but_first
@pytest.mark.parametrize("size", [(1, 1), (40, 30), (333, 517), (1000, 90), (720, 1280)])
def test_any_size_of_image_is_taken(detector, size):
    image = np.full((size[1], size[0], 3), 90, np.uint8)
    for gsd_m in (None, 1e-4, 0.03, 5.0):
        assert len(detector.detect(image, gsd_m=gsd_m)) == 0


def test_a_vehicle_at_an_odd_place_of_an_odd_image(renderer, detector):
    view = camera(size=(397, 243))
    things = bodies((UGV, 3.3, -1.7, 1.0))
    found = detector.detect(renderer.draw(view, things), gsd_m=40.0 / 1200.0)
    (want,) = truth(view, things)
    assert len(found) == 1
    np.testing.assert_allclose(found.centre[0], want[:2], atol=0.1 * want[2])
    assert abs(wrap(found.heading[0] - want[4])) < 0.15


@pytest.mark.slow
def test_same_image_same_boxes(renderer, detector):
    image = renderer.draw(camera(), team(3))
    a, b = detector.detect(image), open_detector().detect(image)
    np.testing.assert_array_equal(a.boxes, b.boxes)


@pytest.mark.parametrize(
    ("image", "seen"), [((1920, 1080), 960), ((3840, 2160), 1920), ((1280, 720), 960), ((640, 480), 640)]
)
def test_small_images_of_unknown_ground_resolution_are_not_made_smaller_still(image, seen):
    class Session:
        def get_modelmeta(self):
            notes = {"stride": "4", "nominal_length_px": "29", "nominal_length_m": "2.5"}
            return type("Meta", (), {"custom_metadata_map": notes})

        def get_inputs(self):
            return [type("Input", (), {"name": "image", "type": "tensor(uint8)", "shape": [1, "h", "w", 3]})]

        def get_outputs(self):
            return [type("Output", (), {"name": "map", "type": "tensor(float)", "shape": [1, 9, "r", "c"]})]

        def run(self, _names, feed):
            widths.append(feed["image"].shape[2])
            return [np.zeros((1, 9, feed["image"].shape[1] // 4, feed["image"].shape[2] // 4), np.float32)]

    widths: list[int] = []
    HeatmapDetector(Session(), "a fake", score=0.3).detect(np.zeros((image[1], image[0], 3), np.uint8))
    # before, vehicles were looked for at other scales, that would have told how large they are
    assert widths[-1] == seen
    widths.clear()
    HeatmapDetector(Session(), "a fake", score=0.3).detect(np.zeros((720, 1280, 3), np.uint8), gsd_m=0.5 / (29 / 2.5))
    assert widths == [640]


def test_bundled_model_is_small_and_says_what_it_is():
    assert BUNDLED.stat().st_size < 5_000_000
    assert isinstance(open_detector(), HeatmapDetector)


def cells_with(*peaks, shape=(8, 10)):
    """A map with given cells: (row, column, score, dx, dy, length, width, heading, sureness) in cells and radians."""
    out = np.zeros((decode_heatmap.CHANNELS, *shape), np.float32)
    for r, c, score, dx, dy, length, width, h, sure in peaks:
        front, axis = (sure * np.sin(h), sure * np.cos(h)), (np.sin(2 * h), np.cos(2 * h))
        out[:, r, c] = (score, dx, dy, np.log(length), np.log(width), *front, *axis)
    return out


@pytest.mark.parametrize("heading", np.arange(0.05, 6.2, 0.5).tolist())
def test_decoding_a_peak(heading):
    cells = cells_with((2, 3, 0.8, 0.25, -0.5, 7.0, 4.0, heading, 0.9))
    found = decode_heatmap.decode(cells, 4, 0.3)
    np.testing.assert_allclose(found.boxes[0, :4], [(3.5 + 0.25) * 4, (2.5 - 0.5) * 4, 28, 16], rtol=1e-6)
    assert found.heading[0] == pytest.approx(heading, abs=1e-6)
    assert wrap(found.angle[0] + np.pi / 2 - heading) == pytest.approx(0.0, abs=1e-6)


def test_a_front_in_doubt_is_not_told_but_the_box_stands():
    cells = cells_with((2, 3, 0.8, 0.0, 0.0, 7.0, 4.0, 1.2, 0.1))
    found = decode_heatmap.decode(cells, 4, 0.3)
    assert np.isnan(found.heading[0])
    assert np.isclose(np.sin(2 * (found.angle[0] + np.pi / 2)), np.sin(2.4))


def test_doubles_are_dropped_and_order_is_by_score():
    cells = cells_with(
        (2, 3, 0.6, 0, 0, 7, 4, 1, 1),
        (2, 5, 0.7, -1.9, 0, 7, 4, 1, 1),  # the same vehicle, seen better
        (6, 8, 0.9, 0, 0, 3, 2, 2, 1),
        (0, 0, 0.2, 0, 0, 7, 4, 1, 1),  # too faint
    )
    assert decode_heatmap.decode(cells, 4, 0.3).score.tolist() == pytest.approx([0.9, 0.7])
    assert len(decode_heatmap.decode(cells_with(), 4, 0.3)) == 0


IMAGE = ("image", UINT8, [1, "h", "w", 3])
ROLLCALL = {"rollcall": "1", "stride": "4", "nominal_length_px": "29", "nominal_length_m": "2.5"}
REFUSED = {
    "marked as ours": (("map", UINT8, [1, "h", "w", 3]), ROLLCALL, "not of its shape: image [1, h, w, 3] uint8"),
    "ours without stride": (("map", UINT8, [1, "h", "w", 3]), {"rollcall": "1"}, "'stride'"),
}


@pytest.mark.parametrize("case", REFUSED.values(), ids=REFUSED.keys())
def test_a_model_of_another_shape_is_refused_with_what_was_found(tmp_path, case):
    out, metadata, told = case
    path = model(tmp_path / "other.onnx", IMAGE, out, metadata)
    with pytest.raises(ModelError) as caught:
        open_detector(path)
    message = str(caught.value)
    assert told in message
    assert "other.onnx" in message


def test_files_that_are_no_models_are_refused(tmp_path):
    with pytest.raises(ModelError, match="no such model file"):
        open_detector(tmp_path / "missing.onnx")
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(ModelError, match="cannot be loaded"):
        open_detector(tmp_path / "text.onnx")
    with pytest.raises(ModelError, match="CPUExecutionProvider"):
        open_detector(providers=["NoSuchProvider"])


def test_options_of_other_models_are_refused_for_the_bundled_one():
    with pytest.raises(ModelError, match="for YOLO models"):
        open_detector(classes=["car"])
    with pytest.raises(ModelError, match="for YOLO models"):
        open_detector(imgsz=640)


def test_an_image_larger_than_any_canvas_is_looked_at_in_tiles(renderer, detector):
    # vehicles of 13 px: enlarged twofold the image is wider than a canvas may be
    view = camera(height=206.0, size=(2300, 240))
    things = bodies(*[(UGV, x, y, x) for x in range(-190, 191, 10) for y in (-5.0, 6.0)])
    quality = measure([detector.detect(renderer.draw(view, things), gsd_m=206.0 / 1200.0)], [truth(view, things)])
    assert quality.recall >= 0.95
    assert quality.precision >= 0.95


def test_quality_figures():
    real = np.array([[10, 10, 8, 4, 0.0, 1], [50, 50, 8, 4, 0.0, 1], [90, 90, 8, 4, 0.0, 0]], dtype=float)

    def made(cx, cy, heading, score):
        return Detections(
            cx=cx,
            cy=cy,
            w=[8.0] * len(cx),
            h=[4.0] * len(cx),
            angle=np.array(heading) - np.pi / 2,
            score=score,
            heading=heading,
        )

    # one right, one turned about, one that is hidden and counts neither way, one false alarm
    quality = measure([made([10, 50, 90, 70], [10, 50, 90, 10], [0.1, np.pi, 0.0, 0.0], [0.9, 0.8, 0.7, 0.6])], [real])
    assert quality.recall == 1.0
    assert quality.precision == pytest.approx(2 / 3)
    assert quality.ap50 == pytest.approx(1.0)
    assert quality.flips == 0.5
    assert quality.heading_deg == pytest.approx(np.degrees(0.1))
    nothing = measure([Detections.empty()], [real])
    assert (nothing.recall, nothing.ap50) == (0.0, 0.0)


def test_importing_says_nothing_to_anybody_and_leaves_nothing_in_the_home_folder(tmp_path):
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    code = "import vision.detect.detector, os; print(os.environ['ORT_DISABLE_TELEMETRY'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert (done.stdout, done.stderr) == ("1\n", "")
    assert list(tmp_path.iterdir()) == []


def test_the_shipped_readme_names_this_very_file():
    readme = (BUNDLED.parent / "README.md").read_text()
    assert hashlib.sha256(BUNDLED.read_bytes()).hexdigest() in readme
    assert BUNDLED.name in readme
