"""Many recordings, each named once: folders, globs, lists or addresses come in, tables for DuckDB and pandas come out.

``run_batch`` is what ``gcs batch`` does. A flight is worked on in a child process, by a pool on this machine or by the
workers of a Dask cluster; its result is put into place when it is whole, with the same bytes wherever it was made.
pyarrow, fsspec and distributed are imported by who needs them: they are extras (``batch``, ``cluster``).
"""
