"""Annotated films with telemetry put under them: boxes, tracks, fronts and names on real pixels, as a table.

python -m bench.annotated FOLDER [--errors standard|hard] [--team 6] [--out bench-results/annotated]
python -m bench.annotated.made_films PICTURES -o FOLDER

FOLDER holds films and their labels as the data sets come, see :mod:`bench.annotated.films`; beside the labels NAME.toml
may say what is known of a film: any field of :class:`gcs.annotated_film.FilmOptions`. The second command makes films
from labelled pictures where no annotated film is at hand.
"""
