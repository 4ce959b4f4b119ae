"""The one band of a TIFF as numbers, read by Pillow and libtiff in a process of its own: the file may be hostile."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from infra.files.safe_open import open_to_read
from infra.processes.bounded import answer_parent, ask_child

_MORE_BYTES, _BYTES_A_CELL = 200_000_000, 12
"""Bytes of memory: decoded, as numbers, and as what is handed over."""
_MAX_S = 120.0


class _TiffQuestion(msgspec.Struct):
    path: str
    most_cells: int
    tags: list[int]


class TiffGrid(msgspec.Struct, tag=True):
    """Grid that was found."""

    rows: int
    columns: int
    bands: int
    numbers: dict[int, list[float]]
    """Values of the tags that were asked for and hold numbers."""
    words: dict[int, str]
    """Texts of those that hold one."""
    cells: bytes
    """Single precision, row by row; none where there is more than one band."""

    def grid(self) -> NDArray[np.float32]:
        """(rows, columns) of the only band."""
        return np.frombuffer(self.cells, np.float32).reshape(self.rows, self.columns)


def read_tiff(path: Path, most_cells: int, tags: list[int]) -> TiffGrid:
    """Read a file.

    Raises:
        UnreadError: no TIFF that can be read.
        OSError: no process can be started for it.
    """
    question = _TiffQuestion(str(path), most_cells, tags)
    most_bytes = _MORE_BYTES + _BYTES_A_CELL * most_cells
    return ask_child(__name__, question, TiffGrid, most_bytes=most_bytes, most_s=_MAX_S)


def _read(question: _TiffQuestion) -> TiffGrid:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with (
            open(open_to_read(question.path), "rb") as file,  # noqa: PTH123 - of a descriptor
            Image.open(file, formats=("TIFF",)) as image,
        ):
            if image.width * image.height > question.most_cells:
                raise ValueError(f"{image.width} × {image.height} cells are too many; cut the area out")
            found: dict[int, Any] = dict(image.tag_v2)  # type: ignore[attr-defined]
            z = np.array(image, dtype=np.float32)
    values = {tag: found[tag] for tag in question.tags if tag in found}
    return TiffGrid(
        rows=z.shape[0],
        columns=z.shape[1],
        bands=1 if z.ndim == 2 else z.shape[2],
        numbers={tag: _numbers(value) for tag, value in values.items() if not isinstance(value, str | bytes)},
        words={tag: value for tag, value in values.items() if isinstance(value, str)},
        cells=z.tobytes() if z.ndim == 2 else b"",
    )


def _numbers(value: Any) -> list[float]:  # noqa: ANN401 - whatever Pillow makes of a tag
    return [float(each) for each in (value if isinstance(value, tuple) else (value,))]


if __name__ == "__main__":
    answer_parent(_TiffQuestion, _read)
