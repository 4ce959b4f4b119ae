"""Figures 7 to 10, drawn from the rows of a run: ``python -m bench.paper.figures [folder]``."""

from __future__ import annotations

import argparse
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from bench.paper import published
from bench.paper.experiments import ROADS, Count
from bench.paper.tables import pooled, published_at
from bench.rows import read

MATPLOTLIB_MISSING = 'matplotlib is not installed; "pip install matplotlib", then "python -m bench.paper.figures"'
Figure = Any
"""matplotlib's, which may be missing."""
_STYLES = ("-", "--", ":")


def draw(out: Path) -> bool:
    """Draw ``figure_7.png`` to ``figure_10.png`` from ``results.csv``.

    Returns:
        False where matplotlib is missing; nothing is drawn then.
    """
    if find_spec("matplotlib") is None:
        return False
    counts = read(out / "results.csv", Count)
    _rotations(out / "figure_7.png", counts, "figure 7", "projection", "sigma_m", "σ of the relative coordinates, m")
    _rotations(out / "figure_8.png", counts, "figure 8", "topology", "sigma_topology", "σ, metres and degrees")
    _rotations(out / "figure_9.png", counts, "figure 9", "fusion", "sigma_m", "σ of projection, m (topology + 0.5)")
    _figure10(out / "figure_10.png", counts)
    return True


def _axes(title: str, xlabel: str) -> tuple[Any, Any]:
    figure: Any = import_module("matplotlib.figure").Figure(figsize=(10, 4.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    figure.suptitle(title)
    for ax, road in zip(axes, ROADS, strict=True):
        ax.set(title=f"{road} road", xlabel=xlabel, ylim=(0, 102))
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("precision, %")
    return figure, axes


def _save(figure: Figure, path: Path) -> None:
    """One legend for both roads, whose curves have the same names."""
    names = figure.axes[0].get_legend_handles_labels()
    figure.legend(*names, fontsize=8, loc="outside lower center", ncols=4)
    figure.savefig(path, dpi=110)


def _rotations(path: Path, counts: list[Count], experiment: str, method: str, axis: str, xlabel: str) -> None:
    figure, axes = _axes(f"{experiment.capitalize()}: {method}", xlabel)
    levels = sorted({getattr(c, axis) for c in counts if c.experiment == experiment})
    rotations = sorted({c.rotation_deg for c in counts if c.experiment == experiment})
    for ax, road in zip(axes, ROADS, strict=True):
        for rotation, style in zip(rotations, _STYLES, strict=False):
            values = _curve(counts, experiment, method, axis, levels, case=road, rotation_deg=rotation)
            ax.plot(levels, values, style, color="tab:blue", label=f"{method}, ours, {rotation:g}°")
        if experiment == "figure 9":
            for part, color in (("projection", "tab:cyan"), ("topology", "tab:olive")):
                values = _curve(counts, experiment, part, axis, levels, case=road, rotation_deg=0.0)
                ax.plot(levels, values, color=color, label=f"{part}, ours, 0°")
            ax.axhline(published.FIG9_HIGH, color="tab:gray", linestyle="-.", label="published, high noise")
        else:
            printed = [published_at(experiment, road, level) for level in levels]
            ax.plot(levels, printed, color="tab:gray", linestyle="-.", label="published, 0°, by its steps")
        asked, values = _asked(levels, _curve(counts, experiment, "identifier", axis, levels, case=road))
        ax.plot(asked, values, color="tab:red", marker=".", label="identifier")
    _save(figure, path)


def _figure10(path: Path, counts: list[Count]) -> None:
    figure, axes = _axes("Figure 10: topology and TTS", "σ, metres and degrees")
    levels = sorted({c.sigma_topology for c in counts if c.experiment == "figure 8"})
    for ax, road in zip(axes, ROADS, strict=True):
        for method, style in (
            ("topology", "-"),
            ("topology signed", "--"),
            ("TTS", "-"),
            ("TTS one step", "--"),
            ("TTS all pairs", ":"),
            ("identifier", "-"),
        ):
            color = {"t": "tab:blue", "T": "tab:green", "i": "tab:red"}[method[0]]
            values = _curve(counts, "figure 8", method, "sigma_topology", levels, case=road, rotation_deg=0.0)
            ax.plot(*_asked(levels, values), style, color=color, label=method)
    _save(figure, path)


def _curve(
    counts: list[Count], experiment: str, method: str, axis: str, levels: list[float], **where: object
) -> list[float]:
    """Precision at each noise level, NaN where the method was not asked."""
    points = [pooled(counts, experiment, method, **{axis: level}, **where) for level in levels]
    return [point.precision if point else float("nan") for point in points]


def _asked(levels: list[float], values: list[float]) -> tuple[list[float], list[float]]:
    """The points that were measured."""
    points = [(level, value) for level, value in zip(levels, values, strict=True) if value == value]
    return [level for level, _ in points], [value for _, value in points]


def main() -> None:
    """Draw again from the rows of an earlier run."""
    parser = argparse.ArgumentParser(description="Figures 7 to 10 from the results of python -m bench.paper.")
    parser.add_argument("folder", type=Path, nargs="?", default=Path("bench-results/paper"))
    if not draw(parser.parse_args().folder):
        raise SystemExit(MATPLOTLIB_MISSING)


if __name__ == "__main__":
    main()
