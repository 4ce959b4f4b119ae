"""Annotated films in a folder.

    MOT Challenge, DynUAV   NAME/gt/gt.txt with NAME/img1/
    UAVDT-M                 NAME_gt_whole.txt, else NAME_gt.txt, with a folder NAME of images
    VisDrone                annotations/NAME.txt with sequences/NAME/
    DRIFT, csv, others      NAME.csv or NAME.txt with a video NAME.* or a folder NAME of images

A folder or video is looked for anywhere below.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gcs.annotated_film import IMAGE_SUFFIXES, FilmOptions
from gcs.errors import GcsError
from gcs.session.session import VIDEO_SUFFIXES
from infra.toml_tables import MOST_TOML_BYTES, build, parse_toml

__all__ = ["AnnotatedFilm", "find_films"]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnotatedFilm:
    """One film and what is known of it."""

    name: str
    labels: Path
    video: Path
    """A file, or a folder of numbered images."""
    options: FilmOptions


def find_films(folder: Path) -> list[AnnotatedFilm]:
    """All films below a folder that have labels, by name.

    Raises:
        GcsError: none, or a NAME.toml that cannot be used.
    """
    videos, labels = {}, {}
    for path in sorted(folder.rglob("*")):
        if path.is_dir() and any(inside.suffix.lower() in IMAGE_SUFFIXES for inside in path.iterdir()):
            videos[path.parent.name if path.name == "img1" else path.name] = path
        elif path.suffix.lower() in VIDEO_SUFFIXES:
            videos[path.stem] = path
        elif path.suffix.lower() in (".txt", ".csv"):
            name = _film_of(path)
            # the fuller file of UAVDT's two comes later in the order of names
            labels[name] = path
    found = [
        AnnotatedFilm(name=name, labels=labels[name], video=videos[name], options=_options(labels[name], name))
        for name in sorted(labels.keys() & videos.keys())
    ]
    if not found:
        raise GcsError(
            f"{folder}: no film with labels of its name, as NAME.csv with NAME.mp4 or NAME/gt/gt.txt with NAME/img1"
        )
    return found


def _film_of(labels: Path) -> str:
    if labels.name == "gt.txt" and labels.parent.name == "gt":
        return labels.parent.parent.name
    return labels.stem.removesuffix("_gt_whole").removesuffix("_gt")


def _options(labels: Path, name: str) -> FilmOptions:
    path = labels.with_name(f"{name}.toml")
    if not path.is_file():
        return FilmOptions()
    try:
        return build(FilmOptions, parse_toml(path.read_bytes()[:MOST_TOML_BYTES], str(path)), str(path))
    except ValueError as error:
        raise GcsError(str(error)) from None
