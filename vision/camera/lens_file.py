"""Files that describe a camera: our own TOML, and the YAML of OpenCV and of ROS.

Ours has the keys of :class:`vision.camera.intrinsics.Intrinsics` and, when ``gcs calibrate`` wrote it, a table
[calibration] with its quality. OpenCV's and ROS's pixels count from the middle of the first one, ours from its
corner: half a pixel is added to their principal points.
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from infra.files.safe_open import read_small
from infra.yaml_text import parse_yaml
from vision.camera.intrinsics import Intrinsics
from vision.errors import CameraError

CORNER_PX = 0.5
"""Shift from OpenCV's pixels to ours."""
NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")
KNOWN = (*NUMBERS, "distortion", "calibration")
YAML = (".yaml", ".yml")
MAX_BYTES = 256 << 10
"""A lens takes less than 1 KiB; calibration programs add tables to it."""
MAX_PX = 16384
"""Longest side of any camera's picture."""
_LARGEST = sys.float_info.max
PINHOLE = ("", "plumb_bob", "rational_polynomial")


def lens_text(intrinsics: Intrinsics, calibration: dict[str, Any]) -> str:
    """The text of a lens file; ``calibration``: how it was found, plain values."""
    table: dict[str, Any] = {name: getattr(intrinsics, name) for name in NUMBERS}
    table["distortion"] = intrinsics.distortion.tolist()
    return tomli_w.dumps({**table, "calibration": calibration})


def read_lens(path: Path) -> Intrinsics:
    """Read a lens file; ``.yaml`` and ``.yml`` are OpenCV's or ROS's, anything else is TOML.

    Raises:
        CameraError: no such file, or no description of a camera in it.
    """
    try:
        text = read_small(path, MAX_BYTES).decode()
    except FileNotFoundError:
        raise CameraError(f"{path}: no such file; gcs calibrate makes one from a video of a chessboard") from None
    except OSError as error:
        raise CameraError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise CameraError(f"{path}: cannot be read as text: {error}") from error
    try:
        return _from_yaml(text) if path.suffix.lower() in YAML else _from_toml(text)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from error


def _from_toml(text: str) -> Intrinsics:
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a bare ValueError
        raise CameraError(f"not valid TOML: {error}") from error
    unknown = [key for key in table if key not in KNOWN]
    if unknown:
        raise CameraError(f"unknown key {unknown[0]!r}; known are {', '.join(KNOWN)}")
    lens = table.get("distortion", [0.0] * 5)
    if not isinstance(lens, list) or not all(map(_is_number, lens)):
        raise CameraError(f"distortion is {lens!r}; a list of the five numbers k1 k2 p1 p2 k3 is needed")
    return _camera({name: table.get(name) for name in NUMBERS}, lens)


def _from_yaml(text: str) -> Intrinsics:
    """``camera_matrix``, ``distortion_coefficients`` and ``image_width``, ``image_height``, as both write them."""
    # OpenCV's first line is "%YAML:1.0", which is no directive of YAML's, and its matrices have types of its own
    body = text.partition("\n")[2] if text.startswith("%YAML:") else text
    body = re.sub(r"!!opencv-[\w-]+", "", body)
    try:
        table = parse_yaml(body)
    except ValueError as error:
        raise CameraError(str(error)) from None
    if not isinstance(table, dict):
        raise CameraError("not YAML of a camera: no names with values in it")
    model = table.get("distortion_model")
    kind = model if isinstance(model, str) else ""
    if kind not in PINHOLE:
        raise CameraError(f"distortion model {kind!r} is not supported, only {' and '.join(PINHOLE[1:])}")
    K, lens = _matrix(table.get("camera_matrix")), _matrix(table.get("distortion_coefficients"))
    size = [table.get(name) for name in ("image_width", "image_height")]
    if K.size != 9 or lens.size < 4 or not all(size):
        raise CameraError("needs camera_matrix, distortion_coefficients, image_width and image_height")
    if lens[5:].any():
        raise CameraError(f"has {lens.size} distortion coefficients; only the five k1 k2 p1 p2 k3 are supported")
    fx, cx, fy, cy = K[[0, 2, 4, 5]] + (0.0, CORNER_PX, 0.0, CORNER_PX)
    numbers = dict(zip(NUMBERS, (*size, float(fx), float(fy), float(cx), float(cy)), strict=True))
    return _camera(numbers, np.pad(lens, (0, 5))[:5].tolist())


def _matrix(node: object) -> np.ndarray[Any, np.dtype[np.float64]]:
    """All numbers of a matrix, row by row; empty where one of them is none."""
    data = node.get("data") if isinstance(node, dict) else None
    try:
        return np.array([float(value) for value in data] if isinstance(data, list) else [], dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)


def _camera(numbers: dict[str, Any], lens: list[float]) -> Intrinsics:
    missing = [name for name, value in numbers.items() if value is None]
    if missing:
        raise CameraError(f"{missing[0]} is missing")
    wrong = [name for name, value in numbers.items() if not _is_number(value)]
    if wrong:
        raise CameraError(f"{wrong[0]} is {numbers[wrong[0]]!r}; a number is needed")
    for name in ("width", "height"):
        if not MAX_PX >= numbers[name] >= 1:
            raise CameraError(f"{name} is {numbers[name]}; a number of pixels up to {MAX_PX} is needed")
    sides = {name: int(numbers[name]) for name in ("width", "height")}
    return Intrinsics(**{**numbers, **sides}, distortion=np.array(lens, dtype=np.float64))


def _is_number(value: object) -> bool:
    """Tell whether it is one that a float can be: TOML and YAML know whole numbers without end."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
