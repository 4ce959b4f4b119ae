"""One session as spans: where the product was wrong or had no name, on which track, with name and confidence."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.field.families import film_of, has_pixels, scenario_of
from bench.field.measure import tally
from bench.field.product import identify
from bench.field.suite import write_motion
from bench.field.summary import summarise
from gcs.report.score import Matched
from sim.session import write_session
from sim.world.scenario import FIRST_UGV_ID, Scenario

BRIDGE_S = 0.35
"""Spans of the same kind on the same track are one when no more than this lies between them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _BoxEvidence:
    """Evidence of one box in the log, besides its name."""

    residual_m: float
    runner_up: int
    runner_up_confidence: float


@dataclass(slots=True, kw_only=True)
class Span:
    """Boxes in a row that are wrong or unnamed alike."""

    truth: int
    track: int
    named: int
    rows: list[int]
    """Into the matched boxes, by time."""


def explain(number: int, hard: bool, seed: int) -> str:
    """Play one session and list what went wrong in it."""
    scenario = scenario_of(number, hard, seed)
    with tempfile.TemporaryDirectory(prefix="field-") as folder:
        write_session(scenario, Path(folder) / "session", film=film_of(number, hard, seed))
        if has_pixels(number, hard, seed):
            write_motion(scenario, Path(folder) / "session")
        played = identify(
            Path(folder) / "session", Path(folder) / "out", (scenario.camera.width, scenario.camera.height)
        )
        evidence = _read_identity(Path(folder) / "out" / "identity.jsonl")
        events = [json.loads(line) for line in (Path(folder) / "out" / "events.jsonl").read_text().splitlines()]
    m, s = played.matched, summarise([tally(played.matched, scenario.fps)])
    lines = [f"{scenario.name}   family {number} seed {seed}", *_setting(scenario)]
    lines.append(
        f"precision {s.precision:.2f}  right {s.right:.2f}  coverage {s.coverage:.2f}  FPER {s.fper:.2f}  "
        f"wrong at 0.9 {s.wrong_sure_s:.1f} s  ECE {s.ece:.3f}  switches {s.switches}  tracks' IDF1 {s.track_idf1:.1f}"
    )
    lines += ["", "true   track     from      to  boxes  named  confidence      residual  runner-up"]
    lines += [_span_line(span, m, evidence, scenario) for span in spans(m, scenario.fps)]
    lines += ["", *_tracks(m, scenario)]
    lines += [f"{_seconds(e['time_us'], scenario):7.1f} s  {e['text']}" for e in events if e["level"] == "alarm"]
    return "\n".join(lines)


def spans(m: Matched, fps: float) -> list[Span]:
    """All spans of boxes of ours without their right name, and of named false targets, in order of time."""
    bad = np.where(m.truth > 0, m.named != m.truth, m.named > 0)
    open_spans: dict[tuple[int, int, int], Span] = {}
    found: list[Span] = []
    for row in np.flatnonzero(bad)[np.argsort(m.frame[bad], kind="stable")].tolist():
        key = (int(m.truth[row]), int(m.track[row]), max(int(m.named[row]), 0))
        span = open_spans.get(key)
        if span is None or m.frame[row] - m.frame[span.rows[-1]] > BRIDGE_S * fps:
            span = open_spans[key] = Span(truth=key[0], track=key[1], named=key[2], rows=[])
            found.append(span)
        span.rows.append(row)
    return found


def _read_identity(path: Path) -> dict[tuple[int, int], _BoxEvidence]:
    table = {}
    for line in path.read_text().splitlines():
        row = json.loads(line)
        table[row["frame"], row["track_id"] or 0] = _BoxEvidence(
            residual_m=math.nan if row["residual_m"] is None else row["residual_m"],
            runner_up=row["runner_up"] or 0,
            runner_up_confidence=row["runner_up_confidence"] or 0.0,
        )
    return table


def _span_line(span: Span, m: Matched, evidence: dict[tuple[int, int], _BoxEvidence], scenario: Scenario) -> str:
    rows = span.rows
    start, stop = (m.frame[rows[k]] / scenario.fps for k in (0, -1))
    notes = [evidence[int(m.frame[r]), span.track] for r in rows if (int(m.frame[r]), span.track) in evidence]
    residual = [n.residual_m for n in notes if math.isfinite(n.residual_m)]
    confidence = m.confidence[rows]
    sure = "unknown" if np.isnan(confidence).all() else f"{np.nanmean(confidence):.2f} (to {np.nanmax(confidence):.3f})"
    rival = ""
    if notes:
        ids = [n.runner_up for n in notes]
        most = max(set(ids), key=ids.count)
        rival = f"{most} {np.mean([n.runner_up_confidence for n in notes if n.runner_up == most]):.2f}" if most else "-"
    who = str(span.truth) if span.truth > 0 else "false"
    name = str(span.named) if span.named else "none"
    away = f"{np.median(residual):.2f} m" if residual else "-"
    return f"{who:>5}{span.track:>7}{start:>9.1f}{stop:>8.1f}{len(rows):>7}  {name:<6}{sure:>17}{away:>10}  {rival}"


def _setting(scenario: Scenario) -> Iterator[str]:
    """The errors that were put in."""
    a, g, t = scenario.attitude, scenario.gnss, scenario.timing
    yield (
        f"compass {a.compass_bias_deg:+.1f}°, tilt {a.tilt_pitch_deg:+.1f}° {a.tilt_roll_deg:+.1f}°, UAV "
        f"{g.uav_bias_m:.1f} m, height {g.height_bias_m:+.1f} m; GNSS white {g.white_m:g} m, bias {g.bias_m:g} m; "
        f"video {t.video_offset_s:+.2f} s ({t.declared_offset}), {t.rate_min_hz:g}-{t.rate_max_hz:g} Hz, "
        f"loss {t.loss:.0%}"
    )
    for fault in scenario.faults:
        victim = f" as {FIRST_UGV_ID + fault.other}" if fault.kind in ("spoof", "copy") else ""
        stop = "" if fault.stop_s > scenario.duration_s else f" to {fault.stop_s:.1f}"
        yield f"{FIRST_UGV_ID + fault.vehicle} is {fault.kind}{victim} from {fault.start_s:.1f}{stop} s"


def _tracks(m: Matched, scenario: Scenario) -> Iterator[str]:
    """Which tracks followed each vehicle, and which of them followed another one too."""
    for vehicle in np.unique(m.truth[m.truth > 0]).tolist():
        mine = (m.truth == vehicle) & (m.track > 0)
        parts = []
        for track in dict.fromkeys(m.track[mine].tolist()):
            frames = m.frame[mine & (m.track == track)] / scenario.fps
            others = np.unique(m.truth[(m.track == track) & (m.truth != vehicle) & (m.truth >= 0)])
            shared = f" also {', '.join(str(o) if o else 'false' for o in others)}" if len(others) else ""
            parts.append(f"{track} ({frames.min():.1f}-{frames.max():.1f} s{shared})")
        yield f"{vehicle}: tracks {', '.join(parts)}"


def _seconds(t_us: int, scenario: Scenario) -> float:
    return (t_us - scenario.start_us) * 1e-6 - scenario.timing.video_offset_s
