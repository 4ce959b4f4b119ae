"""The table of what a stranger can hand us: it names what is there, has no empty cell, and lacks no reader."""

import re
from pathlib import Path

PAGE = Path("docs/strangers.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in PAGE.splitlines() if line.startswith("| ")][
    1:
]
OPENS = re.compile(
    r"\b(read_small|open_to_read|InferenceSession|create_server|urlsplit|url_to_fs)\(|av\.open\(|sqlite3\.connect\("
    r"|socket\.socket\("
)
OURS = {
    *("gcs.export.maps.geopackage", "gcs.export.motion_imagery.klv", "gcs.export.mp4", "gcs.export.subtitles.mkv"),
    *("infra.files.safe_open", "vision.video.recording"),
    *("gcs.cli.demo", "gcs.flight.practice"),
}
"""What writes, and what the readers call."""


def test_every_row_is_whole():
    assert len(ROWS) > 20
    for row in ROWS:
        assert len(row) == 4 and all(row), row


def test_readers_and_tests_are_there():
    written = {
        name
        for path in Path("tests").rglob("test_*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text(encoding="utf-8"))
    }
    for _, readers, _, tests in ROWS:
        for module in re.findall(r"`([\w.]+)`", readers):
            assert Path(module.replace(".", "/")).with_suffix(".py").is_file(), module
        names = re.findall(r"`([\w/.]+)`", tests)
        assert names
        for name in names:
            assert Path(name).is_file() or name in written, name


def test_no_reader_is_missing():
    named = set(re.findall(r"`([\w.]+)`", " ".join(row[1] for row in ROWS)))
    opening = {
        ".".join(path.with_suffix("").parts)
        for folder in ("gcs", "mavlink", "vision", "infra")
        for path in Path(folder).rglob("*.py")
        if "training" not in path.parts and OPENS.search(path.read_text(encoding="utf-8"))
    }
    assert opening - named - OURS == set()
