"""HOTA, IDF1 and the like of an exported MOTChallenge folder, by TrackEval.

pip install trackeval
python bench/interop/mot_trackeval.py FOLDER…
"""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

FIGURES = (("HOTA", "HOTA"), ("HOTA", "DetA"), ("HOTA", "AssA"), ("Identity", "IDF1"), ("CLEAR", "MOTA"))


def figures(folder: Path) -> dict[str, dict[str, float]]:
    """For each tracker, its figures in percent."""
    import trackeval

    with TemporaryDirectory() as out:
        dataset = {
            "GT_FOLDER": str(folder / "gt"),
            "TRACKERS_FOLDER": str(folder / "trackers"),
            "OUTPUT_FOLDER": out,
            "BENCHMARK": "rollcall",
            "SPLIT_TO_EVAL": "all",
            "PRINT_CONFIG": False,
        }
        quiet = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "PLOT_CURVES": False}
        metrics = [one({"PRINT_CONFIG": False}) for one in (trackeval.metrics.HOTA, trackeval.metrics.CLEAR)]
        metrics.append(trackeval.metrics.Identity({"PRINT_CONFIG": False}))
        with contextlib.redirect_stdout(io.StringIO()):
            evaluator = trackeval.Evaluator({**trackeval.Evaluator.get_default_eval_config(), **quiet})
            found: dict[str, Any] = evaluator.evaluate([trackeval.datasets.MotChallenge2DBox(dataset)], metrics)[0]
    trackers = found["MotChallenge2DBox"]
    return {name: _percent(trackers[name]["COMBINED_SEQ"]["pedestrian"]) for name in sorted(trackers)}


def _percent(all_figures: Any) -> dict[str, float]:  # noqa: ANN401 (nested dictionaries of arrays)
    return {
        name: 100.0 * float(sum(v) / len(v)) if name in ("HOTA", "DetA", "AssA") else 100.0 * float(v)
        for kind, name in FIGURES
        if (v := all_figures[kind][name]) is not None
    }


def main(folders: list[str]) -> None:
    names = [name for _, name in FIGURES]
    print(f"| folder | tracker | {' | '.join(names)} |\n|---|---|{'---:|' * len(names)}")
    for folder in map(Path, folders):
        for tracker, found in figures(folder).items():
            print(f"| {folder.name} | {tracker} | {' | '.join(f'{found[name]:.2f}' for name in names)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
