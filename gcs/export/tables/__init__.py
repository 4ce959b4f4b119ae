"""Boxes with their names as Parquet: identity rows in, columns out; one schema for exports and batches."""
