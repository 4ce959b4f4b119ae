"""Readers of what people fly with: a file of one format in, a ``VehicleLog`` with notes out.

Bad records are counted and left out; a file that cannot be used at all is one clear error. Memory is bounded.
"""
