"""An annotated film from a public data set as a session: labels and pixels in, an ordinary session folder out.

What the film's camera was and how it flew is not known; a plausible one is made up (``sim.annotated``), with the motion
that the pixels show. Then the whole product can be measured on real pixels: boxes, tracks and names.
"""

from __future__ import annotations

import configparser
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import tomli_w
from numpy.typing import NDArray

from gcs.errors import GcsError
from gcs.session.session import VIDEO_SUFFIXES
from sim.annotated.camera_guess import guess_camera
from sim.annotated.film_world import FilmWorld, film_world
from sim.annotated.layouts import read_tracks
from sim.annotated.session import read_attributes, write_film_session
from sim.annotated.tracks import AnnotatedTracks
from sim.render.film import encode
from sim.world.error_draws import hard_errors, standard_errors
from vision.detect.detections import Detections
from vision.motion.estimator import MotionEstimator
from vision.video.image_file import read_image
from vision.video.video import VideoFile

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]
Report = Callable[[int, int], None]

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")
FPS = 30.0
"""Rate of numbered images whose rate nothing tells: what most cameras film at."""
CRF = 17
"""Quality of numbered images as video: no difference is seen."""
OUTSIDE = "outside the image"
"""Reason why a label is left out."""
MAX_OUTSIDE, MAX_UNKNOWN = 0.05, 0.2
"""Share of labels outside the image, and of steps whose motion the pixels do not show, from which on there is a
warning."""
MIN_FPS, MAX_FPS = 0.5, 120.0
"""Rates that the simulator takes."""


class FilmImages(Protocol):
    """Images in order."""

    n: int
    width: int
    height: int

    def seconds(self) -> FloatArray:
        """(n,) when each was taken, the first at 0."""

    def images(self) -> Iterator[tuple[int, Image]]:
        """Index and (H, W, 3) BGR; one that cannot be decoded is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmOptions:
    """Options for reading a film; None: found out or assumed."""

    layout: str = "auto"
    first_frame: int | None = None
    """Number of the first image in the labels."""
    fps: float | None = None
    duration_s: float | None = None
    """Duration of the film, from its beginning."""
    height_m: float | None = None
    fov_deg: float | None = None
    pitch_deg: float | None = None
    static: bool = False
    """The camera does not move, whatever the pixels say."""
    team: int = 6
    vehicles: tuple[int, ...] = ()
    """Numbers of our vehicles in the labels, instead of a team that is chosen."""
    errors: Literal["standard", "hard"] = "standard"
    boxes_from_labels: bool = False
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmReport:
    """Account of what was read, assumed and left out, a line each."""

    lines: tuple[tuple[str, str], ...]
    """Subject and text."""
    film: FilmWorld


class NumberedImages:
    """A folder of images, in the order of the numbers in their names.

    Raises:
        GcsError: no image in it, or the first one cannot be decoded.
    """

    def __init__(self, folder: Path, fps: float) -> None:
        paths = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
        self._paths = sorted(paths, key=lambda path: ([int(n) for n in re.findall(r"\d+", path.stem)], path.name))
        if not self._paths:
            raise GcsError(f"{folder}: no image in it; give a video file or a folder of numbered images")
        first = read_image(self._paths[0])
        if first is None:
            raise GcsError(f"{self._paths[0]}: cannot be decoded as an image")
        # video has whole blocks of two by two pixels
        self.height, self.width = (side - side % 2 for side in first.shape[:2])
        self.n, self._fps = len(self._paths), fps

    def seconds(self) -> FloatArray:
        """(n,) at an even rate, the first at 0."""
        return np.arange(self.n) / self._fps

    def images(self) -> Iterator[tuple[int, Image]]:
        """Index and (H, W, 3) BGR.

        Raises:
            GcsError: an image that cannot be decoded or has another size than the first.
        """
        for index, path in enumerate(self._paths):
            image = read_image(path)
            if image is None or image.shape[0] < self.height or image.shape[1] < self.width:
                raise GcsError(f"{path}: not an image of {self.width}×{self.height} px as the first one")
            yield index, np.ascontiguousarray(image[: self.height, : self.width])


class _VideoFilm:
    def __init__(self, video: VideoFile) -> None:
        self._video = video
        self.n, self.width, self.height = video.n, video.width, video.height

    def seconds(self) -> FloatArray:
        return np.asarray((self._video.times_us - self._video.times_us[0]) * 1e-6)

    def images(self) -> Iterator[tuple[int, Image]]:
        for frame in self._video.frames():
            yield frame.index, frame.image


def session_from_film(
    labels: Path, video: Path, out: Path, options: FilmOptions, report: Report = lambda done, total: None
) -> FilmReport:
    """Write a session from an annotated film.

    Args:
        labels: file of annotated tracks, in one of the layouts of ``sim.annotated.layouts``.
        video: film as a video file, or folder of numbered images.
        out: session folder, which must not exist.
        options: what is known of the film and wanted of the session.
        report: called with the images that are done so far, and all there are.

    Raises:
        GcsError, SimError, VisionError: labels or film cannot be used, or do not belong together.
    """
    if out.exists():
        raise GcsError(f"{out}: exists already; recordings are never overwritten, give another name")
    tracks = read_tracks(labels, options.layout, options.first_frame)
    rate, rate_words = _rate(labels, video, options.fps)
    film: FilmImages = NumberedImages(video, rate) if video.is_dir() else _VideoFilm(_opened(video))
    t = film.seconds()
    if options.duration_s is not None:
        t = t[t < options.duration_s]
    fitting = _fitting(tracks, len(t), (film.width, film.height), labels, video)
    attributes = read_attributes(labels) if tracks.layout == "uavdt" else ()
    pitch = -90.0 if options.pitch_deg is None and "bird-view" in attributes else options.pitch_deg
    size = (film.width, film.height)
    camera = guess_camera(fitting, size, height_m=options.height_m, fov_deg=options.fov_deg, pitch_deg=pitch)
    motions = None if options.static else _motions(film, fitting, len(t), report)
    draw = standard_errors if options.errors == "standard" else hard_errors
    made = film_world(
        fitting,
        t,
        camera,
        size,
        motions,
        draw(np.random.default_rng(options.seed)),
        team=options.team,
        chosen=options.vehicles,
        seed=options.seed,
    )
    write_film_session(made, fitting, t, out, boxes_from_labels=options.boxes_from_labels)
    if video.is_dir():
        images = (image for index, image in film.images() if index < len(t))
        encode(images, t, out / "video.mp4", size=size, fps=made.world.scenario.fps, crf=CRF, report=report)
    else:
        shutil.copyfile(video, out / f"video{video.suffix.lower()}")
    left = ", ".join(f"{count} {reason}" for reason, count in fitting.left_out.items())
    steps_known = None if motions is None else sum(H is not None for H in motions[1:])
    doubts = _doubts(fitting, None if steps_known is None else (steps_known, len(t) - 1))
    lines = (
        ("labels", f"{len(fitting)} of {made.vehicles} vehicles, read as {fitting.layout}"),
        ("left_out", f"{left or 'nothing'}; {int(fitting.hidden.sum())} mostly hidden are not in the truth"),
        ("film", f"{len(t)} images of {size[0]}×{size[1]} px, {t[-1]:.1f} s, {rate_words}"),
        *((("notes", ", ".join(attributes)),) if attributes else ()),
        ("camera", ", ".join(camera.sources)),
        (
            "motion",
            "none (--static)" if steps_known is None else f"from the pixels in {steps_known} of {len(t) - 1} steps",
        ),
        ("team", ", ".join(_member(made, index) for index in range(len(made.team)))),
        ("errors", options.errors),
        ("boxes", "the labels" if options.boxes_from_labels else "the detector's, on the film"),
        *((("doubts", "; ".join(doubts)),) if doubts else ()),
    )
    (out / "film.toml").write_text(tomli_w.dumps(dict(lines)), encoding="utf-8")
    return FilmReport(lines=lines, film=made)


def _doubts(tracks: AnnotatedTracks, steps_known: tuple[int, int] | None) -> list[str]:
    """Warnings of what may be wrong with labels or film; steps_known: steps whose motion is known, and all of them."""
    doubts = []
    outside = tracks.left_out.get(OUTSIDE, 0)
    if outside > MAX_OUTSIDE * (len(tracks) + outside):
        doubts.append(f"{outside} labels lie outside the image: are they of this film, at this size?")
    if steps_known is not None and steps_known[0] < (1.0 - MAX_UNKNOWN) * steps_known[1]:
        doubts.append("where the pixels do not tell the motion the camera is taken to stand: vehicles may leap there")
    return doubts


def _member(made: FilmWorld, index: int) -> str:
    track = made.team[index]
    name = f"UGV-{made.world.scenario.ugv_ids[index]}"
    return f"{name} = {track.track} ({len(track.frames)} images{'' if track.moved else ', parked'})"


def _opened(video: Path) -> VideoFile:
    if video.suffix.lower() not in VIDEO_SUFFIXES:
        raise GcsError(f"{video}: not a video file ({', '.join(VIDEO_SUFFIXES)}) nor a folder of numbered images")
    return VideoFile.open(video)


def _rate(labels: Path, video: Path, fps: float | None) -> tuple[float, str]:
    """Frames per second of numbered images, and where that is from."""
    if not video.is_dir():
        if fps is not None:
            raise GcsError(f"{video}: a video file has times of its own; leave --fps out")
        return FPS, "times as in the file"
    source = "as given"
    if fps is None:
        fps, source = _sequence_rate(labels)
    if not MIN_FPS <= fps <= MAX_FPS:
        raise GcsError(f"{fps:g} images a second cannot be simulated; give --fps from {MIN_FPS:g} to {MAX_FPS:g}")
    return fps, f"{fps:g} a second {source}"


def _sequence_rate(labels: Path) -> tuple[float, str]:
    """Rate that MOT Challenge's seqinfo.ini gives, beside the labels' folder."""
    parser = configparser.ConfigParser()
    for folder in (labels.parent, labels.parent.parent):
        try:
            parser.read(folder / "seqinfo.ini", encoding="utf-8")
            return parser.getfloat("Sequence", "frameRate"), "by seqinfo.ini"
        except (configparser.Error, ValueError):
            continue
    return FPS, "assumed"


def _fitting(tracks: AnnotatedTracks, n: int, size: tuple[int, int], labels: Path, video: Path) -> AnnotatedTracks:
    """Labels of images that are there, in the image."""
    fitting = tracks.select(tracks.frame < n, "after the film's last image")
    touches = ((fitting.corners.max(axis=1) > 0.0) & (fitting.corners.min(axis=1) < size)).all(axis=1)
    fitting = fitting.select(touches, OUTSIDE)
    if len(fitting) and fitting.hidden.all():
        raise GcsError(f"{labels}: read as {fitting.layout}, every vehicle is mostly hidden; is --layout right?")
    if not len(fitting):
        raise GcsError(
            f"{labels}: no label in the {n} images of {video}; do they belong together, is --first-frame right?"
        )
    return fitting


def _motions(film: FilmImages, tracks: AnnotatedTracks, n: int, report: Report) -> Sequence[FloatArray | None]:
    """(n,) homography from the image before, px, None where the images do not tell."""
    estimator, boxes = MotionEstimator(), tracks.boxes()
    motions: list[FloatArray | None] = [None] * n
    for index, image in film.images():
        if index >= n:
            break
        here = boxes[slice(*np.searchsorted(tracks.frame, (index, index + 1)))].T
        fill = np.ones(here.shape[1])
        labelled = Detections(
            cx=here[0], cy=here[1], w=here[2], h=here[3], angle=here[4], score=fill, heading=np.nan * fill
        )
        motion = estimator.update(image, labelled)
        motions[index] = None if motion is None else motion.H
        report(index + 1, n)
    return motions
