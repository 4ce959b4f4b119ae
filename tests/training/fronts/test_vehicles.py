from __future__ import annotations

import av
import cv2
import numpy as np
import pytest

from training.fronts.collect import ACROSS, LENGTH, collect_folder, collect_video, detector_of, read_crops
from training.fronts.quality import quality
from training.fronts.vehicles import MEAN, STD, Vehicles, crops_of, jittered
from training.rendered.front_crops import write_shard
from vision.detect.detections import Detections
from vision.detect.front import BUNDLED_FRONT
from vision.errors import ModelError, VideoError
from vision.video.video import VideoFile


def arrows(n=60, shape=(60.0, 30.0), seed=0):
    """Vehicles with a white front half and a black rear, headings all round."""
    rng = np.random.default_rng(seed)
    images = np.full((n, 128, 128, 3), 128, np.uint8)
    boxes = np.tile([64.0, 64.0, *shape, 0.0], (n, 1))
    boxes[:, 4] = rng.uniform(-np.pi, np.pi, n)
    for image, (cx, cy, w, h, angle) in zip(images, boxes, strict=True):
        along = np.array([np.cos(angle), np.sin(angle)])
        for sign, colour in ((1, 255), (-1, 0)):
            middle = np.array([cx, cy]) + sign * 0.25 * w * along - 0.5
            corners = cv2.boxPoints((tuple(middle), (w / 2, h), np.degrees(angle)))
            cv2.fillConvexPoly(image, np.rint(corners * 16).astype(np.int32), (colour,) * 3, cv2.LINE_AA, 4)
    return Vehicles(images=images, boxes=boxes)


def brightest(planes, classes):
    """The side towards which a crop is brightest, as a class."""
    grey = (planes.mean(axis=1) * STD.mean()) + MEAN.mean()
    side = grey.shape[-1]
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    sides = {2: (x, -x), 4: (x, y, -x, -y)}[classes]
    return np.argmax([(grey * s).sum(axis=(1, 2)) for s in sides], axis=0)


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize(("classes", "shape"), [(2, (60.0, 30.0)), (4, (60.0, 30.0)), (4, (44.0, 40.0))])
def test_labels_say_where_the_front_is_after_turns_and_mirrors(classes, shape, light):
    batch = crops_of(arrows(shape=shape), np.random.default_rng(1), side=32, margin=0.15, classes=classes, light=light)
    np.testing.assert_array_equal(batch.label, brightest(batch.planes, classes))
    wanted = {0, 1} if classes == 2 else {0, 1, 2, 3} if shape[0] < 50 else {0, 2}
    assert set(batch.label.tolist()) == wanted


def test_boxes_are_as_inexact_as_told():
    boxes = np.tile([10.0, 20.0, 50.0, 20.0, 0.7], (4000, 1))
    off = jittered(boxes, np.random.default_rng(0)) - boxes
    c, s = np.cos(0.7), np.sin(0.7)
    along, across = c * off[:, 0] + s * off[:, 1], -s * off[:, 0] + c * off[:, 1]
    np.testing.assert_allclose([along.std(), across.std()], [np.hypot(2.0, 0.5), np.hypot(0.8, 0.5)], rtol=0.05)
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.2)
    assert off[:, 4].std() == pytest.approx(np.radians(3.0), rel=0.05)


class Known:
    """Finds one vehicle, and one that the edge cuts."""

    def detect(self, image, *, gsd_m=None):
        return Detections(
            cx=[100.0, 2.0], cy=[60.0, 60.0], w=[20.0, 40.0], h=[40.0, 20.0], angle=[0.0, 0.0], score=[0.9, 0.9],
            heading=[np.nan, np.nan],
        )  # fmt: skip


def film(path, n=12):
    """A short video: an upright box, its upper half white."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 192, 128, "yuv420p", 4_000_000
        for _ in range(n):
            image = np.full((128, 192, 3), 90, np.uint8)
            image[40:60, 90:110], image[60:80, 90:110] = 250, 10
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


def test_crops_of_a_video_lie_along_x_and_show_the_surroundings(tmp_path):
    path = film(tmp_path / "v.mp4")
    with VideoFile.open(path) as video:
        assert video.n == 12
    collect_video(path, Known(), tmp_path, frames=4, most=100)
    crops = read_crops(tmp_path, 0.5)
    assert len(crops) == 4  # every third frame, the cut vehicle left out
    middle, ends = crops.images[0][48], (slice(30, 60), slice(84, 114))
    bright = [float(middle[end].mean()) for end in ends]
    assert max(bright) > 220
    assert min(bright) < 40
    assert middle[:18].mean() == pytest.approx(90, abs=12)
    np.testing.assert_allclose(crops.length_px, 40.0)
    vehicles = crops.vehicles(np.array([True, False, True, True]))
    np.testing.assert_allclose(vehicles.boxes[:, 2:4], [[LENGTH / 1.5, ACROSS / 1.5]] * 4)
    np.testing.assert_allclose(vehicles.boxes[:, 4], [0.0, np.pi, 0.0, 0.0])


def test_crops_of_a_folder(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    wide = np.zeros((20, 40, 3), np.uint8)
    wide[:, 20:] = 200
    cv2.imwrite(str(folder / "a.png"), wide)
    cv2.imwrite(str(folder / "b.png"), np.rot90(wide))  # upright
    (folder / "c.jpg").write_text("no image")
    collect_folder(folder, tmp_path, most=10)
    crops = read_crops(tmp_path, 0.0)
    assert len(crops) == 2
    halves = crops.images[..., 0].astype(float).mean(axis=1)
    assert abs(halves[:, 84:].mean(axis=1) - halves[:, :60].mean(axis=1)).min() > 150
    (tmp_path / "crops" / "00001.png").unlink()
    with pytest.raises(VideoError, match=r"00001\.png: is gone"):
        read_crops(tmp_path, 0.0)


def test_nothing_to_learn_from_is_told(tmp_path):
    with pytest.raises(VideoError, match="no image in it"):
        collect_folder(tmp_path, tmp_path / "out", most=10)
    with pytest.raises(VideoError, match="no such folder"):
        collect_folder(tmp_path / "nowhere", tmp_path / "out", most=10)


def test_the_detector_of_a_mission_file(tmp_path):
    mission = tmp_path / "m.toml"
    mission.write_text('[detector]\nmodel = "mine.onnx"\n')
    with pytest.raises(ModelError, match=r"mine\.onnx: no such model file"):
        detector_of(mission)
    mission.write_text("[detector\n")
    with pytest.raises(ModelError, match=r"m\.toml: cannot be read"):
        detector_of(mission)
    assert detector_of(None).detect(np.zeros((64, 64, 3), np.uint8)) is not None


@pytest.mark.slow
def test_rendered_vehicles_are_where_the_label_says_and_the_bundled_model_knows_their_fronts(tmp_path):
    path = write_shard(tmp_path, 910_000, 120)
    with np.load(path) as shard:
        images, boxes = shard["images"], shard["boxes"].astype(float)
    with np.load(write_shard(tmp_path / "again", 910_000, 20)) as shard:
        np.testing.assert_array_equal(shard["images"], images[:20])
    assert (boxes[:, 2] >= boxes[:, 3]).mean() > 0.95
    np.testing.assert_allclose(boxes[:, :2], 64.0, atol=12.0)
    boxes[:, 4] -= np.pi / 2
    told = quality(BUNDLED_FRONT, Vehicles(images=images, boxes=boxes), boxes[:, 2])[-1]
    assert told["vehicles"] == 120
    assert told["right"] >= 0.85
    assert told["told"] >= 0.7
    assert told["right_of_told"] >= 0.92
