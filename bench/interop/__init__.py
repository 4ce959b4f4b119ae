"""What programs of others make of our exports, where they are too large for the tests' environment.

Each module is a script that needs nothing of ours: it runs in a virtual environment that has the reader alone, is given
what ``gcs export`` wrote, and prints what the reader found. What they printed is kept in ``bench/results/interop/``,
with the commands.
"""
