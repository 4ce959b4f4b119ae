"""Errors of the association package.

::

    AssocError
    ├── DegenerateError    the geometry does not determine the answer
    └── ShapeError         an array does not have the shape that the function needs
"""

from __future__ import annotations


class AssocError(Exception):
    """Base of all errors of this package."""


class DegenerateError(AssocError):
    """The positions do not determine the answer (collinear vehicles, too few of them); the message names the reason."""


class ShapeError(AssocError):
    """An array has another shape than the function needs; the message names both."""
