"""Films with telemetry that is not theirs: each session's film with another one's telemetry, or with its own, late."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from bench.field.product import identify
from bench.field.tables import number
from gcs.session.frame_tables import read_times
from infra.markdown import markdown_table

LATE_S = 25.0
"""How late a film is beside its own telemetry, seconds: longer than any delay that is looked for."""
MOST_S = 36.0
"""What is played of a film, seconds: as long as the sessions of the field suite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairingScore:
    """What the product made of a film and telemetry that do not belong together."""

    film: str
    telemetry: str
    boxes: int
    named: float
    """Share of boxes with a name, percent."""
    mismatch_s: float
    """Seconds to the alarm that video and telemetry do not match, inf never."""


def measure_pairings(
    sessions: Sequence[Path], report: Callable[[int, int], None] = lambda done, total: None
) -> list[PairingScore]:
    """Identify every film with the telemetry of every session, its own 25 s late.

    Args:
        sessions: Folders with truth.
        report: Called with the pairings that are done so far, and all there are.
    """
    pairings, rows = list(product(sessions, repeat=2)), []
    for film, flight in pairings:
        with tempfile.TemporaryDirectory(prefix="pairing-") as folder:
            pair_up(film, flight, Path(folder) / "session", late_s=LATE_S if film == flight else 0.0)
            run = identify(Path(folder) / "session", Path(folder) / "out")
        named = run.matched.named[np.isfinite(run.matched.time_us)] > 0
        rows.append(
            PairingScore(
                film=film.name,
                telemetry=flight.name,
                boxes=len(named),
                named=100.0 * float(np.mean(named)),
                mismatch_s=run.mismatch_s,
            )
        )
        report(len(rows), len(pairings))
    return rows


def pair_up(film: Path, flight: Path, folder: Path, *, late_s: float = 0.0) -> None:
    """Write a session with the boxes of one and the mission and telemetry of another.

    Args:
        film: Session whose film is taken, up to 36 s of it.
        flight: Session whose telemetry is taken, and whose first frame is where the film begins.
        folder: Of the session, which must not exist.
        late_s: Seconds by which the film begins later than that.
    """
    folder.mkdir()
    for source, name in (
        (flight, "session.toml"),
        (flight, "telemetry.tlog"),
        (film, "detections.csv"),
        (film, "truth.csv"),
    ):
        if (source / name).exists():
            shutil.copyfile(source / name, folder / name)
    times_us, begin_us = (read_times(session / "frames.csv").times_us for session in (film, flight))
    moved_us = times_us - times_us[0] + begin_us[0] + round(late_s * 1e6)
    played = moved_us[times_us < times_us[0] + MOST_S * 1e6]
    lines = [f"{frame},{t_us}" for frame, t_us in enumerate(played.tolist())]
    (folder / "frames.csv").write_text("\n".join(["frame,time_us", *lines, ""]))


def pairings_text(rows: Sequence[PairingScore]) -> str:
    """The table in Markdown."""
    cells = [[r.film, r.telemetry, str(r.boxes), number(r.named), number(r.mismatch_s, 1)] for r in rows]
    head = ("film", "telemetry", "boxes", "boxes named, %", "alarm after s")
    return f"# Films with telemetry that is not theirs\n\n{_WORDS}\n\n{markdown_table(head, cells)}\n"


_WORDS = f"""\
The first {MOST_S:g} s of each film, from where that of the telemetry begins; where both are of one session, the film is
{LATE_S:g} s late. alarm: that video and telemetry do not match."""
