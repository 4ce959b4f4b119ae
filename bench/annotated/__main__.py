"""Command line of the table of annotated films."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from bench.annotated.films import find_films
from bench.annotated.table import FilmScore, measure_films, text_of_films
from bench.command_line import RESULTS, count
from bench.paper.rows import write
from gcs.cli.output.console import errors_as_exit_codes, print_note
from gcs.cli.output.progress import progress


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.annotated", description="Annotated films under telemetry")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="films and their labels")
    parser.add_argument("--boxes", choices=("film", "labels"), action="append", help="one of the two rows a film")
    parser.add_argument("--errors", choices=("standard", "hard"), help="of what is reported")
    parser.add_argument("--team", type=count, help="how many of the vehicles are ours")
    parser.add_argument("--seed", type=int, help="of the errors")
    parser.add_argument("--out", type=Path, default=RESULTS / "annotated", help="folder of the results (%(default)s)")
    options = parser.parse_args()
    asked = {name: getattr(options, name) for name in ("errors", "team", "seed") if getattr(options, name) is not None}
    films = [replace(film, options=replace(film.options, **asked)) for film in find_films(options.folder)]
    with progress("annotated") as report:
        rows, failed = measure_films(films, options.boxes or ("film", "labels"), report)
    text = text_of_films(rows, failed, f"Annotated films, errors {options.errors or 'standard'}")
    options.out.mkdir(parents=True, exist_ok=True)
    write(options.out / "annotated.csv", FilmScore, rows)
    (options.out / "annotated.md").write_text(text, encoding="utf-8")
    print(text)
    print_note(f"{len(rows)} rows of {len(films)} films; wrote {options.out}")


if __name__ == "__main__":
    with errors_as_exit_codes():
        main()
