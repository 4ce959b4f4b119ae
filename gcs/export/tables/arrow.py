"""Parquet as every table is written: settings that are fixed, so that the same rows give the same bytes."""

from __future__ import annotations

from types import ModuleType

from gcs.errors import GcsError


def import_pyarrow() -> ModuleType:
    """pyarrow, where it is installed.

    Raises:
        GcsError: it is not.
    """
    try:
        import pyarrow
    except ImportError:
        raise GcsError("Parquet needs pyarrow: pip install 'rollcall-gcs[tables]'") from None
    found: ModuleType = pyarrow
    return found


def writer_settings() -> dict[str, object]:
    """Arguments of ``pyarrow.parquet.ParquetWriter`` beside place and schema; defaults may change."""
    return {
        "version": "2.6",
        "data_page_version": "1.0",
        "compression": "zstd",
        "compression_level": 3,
        "use_dictionary": True,
        "write_statistics": True,
        "store_schema": True,
    }
