"""The formats of ``gcs export``: how each is called, what opens it, and where it is written.

A format's module is imported when the format is asked for: a table needs no video library.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Final, cast

from gcs.errors import GcsError
from gcs.export.job import Export, ExportJob


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat:
    """One format."""

    name: str
    """Name that ``--format`` takes."""
    suffix: str
    """Ending of its file with the dot; empty: it is a folder, and has to be asked for by name."""
    contents: str
    """Content of the files."""
    opened_by: str
    """Programs that open it."""
    writer: str
    """Module in this folder and class."""
    needs_images: bool = False
    """True if snapshots must come with their frame's image: decoding takes longer than all the rest."""
    needs_video: bool = False
    """True if there must be a film, of which it takes more than images."""
    extra: str = ""
    """Optional dependencies that must be installed; empty: none."""

    def open(self, job: ExportJob) -> Export:
        """Begin an export.

        Raises:
            GcsError: the recording lacks what it needs, or a library is not installed.
            SessionError: what is to be written exists, or cannot be made.
        """
        if job.video is None and (self.needs_images or self.needs_video):
            others = ", ".join(
                other.name for other in FORMATS.values() if not (other.needs_images or other.needs_video)
            )
            raise GcsError(f"{job.name}: no video in it, and {self.name} needs one; choose another of {others}")
        module, writer = self.writer.split(":")
        try:
            made = getattr(import_module(f"gcs.export.{module}"), writer)
        except ImportError as error:
            if not self.extra:
                raise
            raise GcsError(
                f"{self.name} needs {error.name}; install it with: pip install 'rollcall-gcs[{self.extra}]'"
            ) from error
        return cast(Export, made(job))


_ALL: Final = (
    ExportFormat(
        name="csv",
        suffix=".csv",
        contents="one row for each box of each frame",
        opened_by="spreadsheets, pandas",
        writer="tables.text:CsvExport",
    ),
    ExportFormat(
        name="jsonl",
        suffix=".jsonl",
        contents="one JSON object for each box of each frame, with the evidence",
        opened_by="jq, pandas, DuckDB",
        writer="tables.text:JsonlExport",
    ),
    ExportFormat(
        name="parquet",
        suffix=".parquet",
        contents="one row for each box of each frame, with the evidence",
        opened_by="DuckDB, pandas, Polars",
        writer="tables.parquet:ParquetExport",
        extra="tables",
    ),
    ExportFormat(
        name="mp4",
        suffix=".mp4",
        contents="the film with boxes and names drawn in",
        opened_by="any player",
        writer="mp4:Mp4Export",
        needs_images=True,
    ),
    ExportFormat(
        name="mkv",
        suffix=".mkv",
        contents="the film untouched, with the names on the vehicles as subtitles",
        opened_by="VLC, mpv",
        writer="subtitles.mkv:MkvExport",
        needs_video=True,
    ),
    ExportFormat(
        name="mcap",
        suffix=".mcap",
        contents="film, boxes, names, vehicles in space, fixes and events, in Foxglove's schemas",
        opened_by="Foxglove, Rerun, PlotJuggler",
        writer="robotics.mcap:McapExport",
        extra="foxglove",
    ),
    ExportFormat(
        name="rosbag",
        suffix="",
        contents="ROS 2 bag: detections with names, fixes, events, pictures",
        opened_by="ros2 bag, rosbags, Foxglove",
        writer="robotics.rosbag:RosbagExport",
        extra="ros",
    ),
    ExportFormat(
        name="klv",
        suffix=".ts",
        contents="the film untouched, with where the UAV was and looked: MISB ST 0601",
        opened_by="players of motion imagery, QGIS, gcs import",
        writer="motion_imagery.klv:KlvExport",
    ),
    ExportFormat(
        name="ass",
        suffix=".ass",
        contents="subtitles: the names on the vehicles",
        opened_by="VLC, mpv, beside the film",
        writer="subtitles.ass:AssExport",
    ),
    ExportFormat(
        name="srt",
        suffix=".srt",
        contents="subtitles: the names, from left to right",
        opened_by="any player, beside the film",
        writer="subtitles.text_cues:SrtExport",
    ),
    ExportFormat(
        name="vtt",
        suffix=".vtt",
        contents="subtitles: the names on the vehicles",
        opened_by="browsers, VLC",
        writer="subtitles.text_cues:VttExport",
    ),
    ExportFormat(
        name="geojson",
        suffix=".geojson",
        contents="boxes as points and tracks as lines on the map",
        opened_by="QGIS, geojson.io, Leaflet",
        writer="maps.geojson:GeoJsonExport",
    ),
    ExportFormat(
        name="gpkg",
        suffix=".gpkg",
        contents="the same as layers of a GeoPackage",
        opened_by="QGIS, ArcGIS, GDAL",
        writer="maps.geopackage:GeoPackageExport",
    ),
    ExportFormat(
        name="kml",
        suffix=".kml",
        contents="tracks with times, a colour for each vehicle",
        opened_by="Google Earth, QGIS",
        writer="maps.kml:KmlExport",
    ),
    ExportFormat(
        name="gpx",
        suffix=".gpx",
        contents="tracks with times",
        opened_by="GPS programs, JOSM",
        writer="maps.gpx:GpxExport",
    ),
    ExportFormat(
        name="cot",
        suffix=".cot",
        contents="Cursor on Target: an event a second for each vehicle",
        opened_by="TAK servers, pytak",
        writer="cot_file:CotExport",
    ),
    ExportFormat(
        name="yolo",
        suffix="",
        contents="training labels: images with oriented boxes (YOLO-OBB)",
        opened_by="Ultralytics, supervision",
        writer="labels.yolo:YoloObbExport",
        needs_images=True,
    ),
    ExportFormat(
        name="dota",
        suffix="",
        contents="training labels: the same in pixels (DOTA)",
        opened_by="MMRotate, datumaro",
        writer="labels.dota:DotaExport",
        needs_images=True,
    ),
    ExportFormat(
        name="coco",
        suffix="",
        contents="training labels: upright boxes with outlines (COCO)",
        opened_by="pycocotools, Detectron2, FiftyOne",
        writer="labels.coco:CocoExport",
        needs_images=True,
    ),
    ExportFormat(
        name="cvat",
        suffix="",
        contents="training labels to correct by hand (CVAT for images 1.1)",
        opened_by="CVAT, datumaro",
        writer="labels.cvat:CvatExport",
        needs_images=True,
    ),
    ExportFormat(
        name="mot",
        suffix="",
        contents="MOTChallenge: the truth where known; ids of names and of bare tracks as two trackers",
        opened_by="TrackEval",
        writer="mot:MotExport",
    ),
)

FORMATS: Final = {form.name: form for form in _ALL}
"""Formats by name, in the order in which they are listed."""


def format_for(path: Path, name: str | None = None) -> ExportFormat:
    """The format of that name, or else the one that the path's ending says.

    Raises:
        GcsError: no such format, or an ending that says none.
    """
    if name is not None:
        if name not in FORMATS:
            raise GcsError(f"no export format {name!r}; there are {', '.join(FORMATS)}")
        return FORMATS[name]
    for form in FORMATS.values():
        if form.suffix and path.name.lower().endswith(form.suffix):
            return form
    raise GcsError(f"{path}: the ending names no format; choose one of {', '.join(FORMATS)} with --format")
